"""Propellers that take time to reach the commanded speed."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place


class ThrusterLag(Effect):
    """T n' = n_c - n with the moment as n |n|: first order in the propeller's speed, not in its thrust."""

    name = "thruster-lag"
    place = Place.ACTUATOR
    parameters = (Parameter("T", "time constant of the propeller speed", "s", 0.0, 3.0, 0.15),)
    equation = "T n' = n_c - n, {f} = n |n|"
    says = "The propellers reach the commanded speed only after a lag."
    reveals = "starts of steps, reversals and square waves; nothing in the steady {move}"
    mistaken_for = ("input-delay", "sensor-lag")
    separated_by = "a fast square wave, or a log of the propeller's speed"
    source = "Yoerger, Cooke and Slotine (1990), IEEE J. Oceanic Engineering 15:167"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        """Mean of n |n| over each step, exact for a command held over it, a change of sign included."""
        (lag,) = values
        wanted = np.sign(commands.force) * np.sqrt(np.abs(commands.force))
        shape = np.broadcast_shapes(wanted.shape, commands.length.shape, lag.shape)
        wanted, length = np.broadcast_to(wanted, shape), np.broadcast_to(commands.length, shape)
        lag = np.broadcast_to(np.maximum(lag, 1e-6), shape)[..., 0]
        delivered = np.empty(shape)
        before = np.sign(commands.before) * np.sqrt(np.abs(commands.before))
        speed = np.broadcast_to(before[..., 0], shape[:2])
        for m in range(shape[2]):
            target, step = wanted[..., m], length[..., m]
            gap = speed - target
            crosses = speed * target < 0
            ratio = np.where(crosses, -target / np.where(gap == 0, 1.0, gap), 1.0)
            zero = np.minimum(-lag * np.log(ratio), step)
            whole, part = _squares(target, gap, lag, step), _squares(target, gap, lag, zero)
            impulse = np.where(crosses, np.sign(speed) * part + np.sign(target) * (whole - part), 0.0)
            sign = np.where(target != 0, np.sign(target), np.sign(speed))
            impulse = np.where(crosses, impulse, sign * whole)
            delivered[..., m] = impulse / np.maximum(step, 1e-12)
            speed = target + gap * np.exp(-step / lag)
        return delivered


def _squares(target: Floats, gap: Floats, lag: Floats, time: Floats) -> Floats:
    """Integral of n² over `time` for n = target + gap exp(-t/lag)."""
    once, twice = -np.expm1(-time / lag), -np.expm1(-2.0 * time / lag)
    return target**2 * time + 2.0 * target * gap * lag * once + 0.5 * gap**2 * lag * twice
