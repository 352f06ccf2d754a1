"""Commands that act late: serial and CAN links, video, software."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Parameter, Place

FAR = 10.0  # seconds before the log over which its first command is taken to have held


class InputDelay(Effect):
    """tau(t - t_d); a delay below half a sample interval is the logger's convention and is fitted apart."""

    name = "input-delay"
    place = Place.ACTUATOR
    parameters = (Parameter("t_d", "dead time of the command", "s", 0.0, 3.0, 0.2),)
    equation = "tau_delivered(t) = tau(t - t_d)"
    says = "The command acts only after a dead time."
    reveals = "starts of steps: a flat start of the same length at all moments; square waves"
    mistaken_for = ("thruster-lag", "sensor-lag")
    separated_by = "a fast square wave, a knock test, or a log of the propeller's speed"
    source = "Franklin, Powell and Emami-Naeini, Feedback Control of Dynamic Systems"

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        """Mean of the delayed command over each step: the delayed impulse is exact for any delay."""
        (delay,) = values
        shape = np.broadcast_shapes(commands.moment.shape, commands.length.shape, delay.shape)
        moment, begin, length, late = (
            np.broadcast_to(x, shape) for x in (commands.moment, commands.start, commands.length, delay)
        )
        before = np.broadcast_to(commands.before, (shape[1], 1))
        out = np.empty(shape)
        for p in range(shape[0]):
            for r in range(shape[1]):
                ends = begin[p, r] + length[p, r]
                nodes = np.concatenate([[begin[p, r, 0] - FAR, begin[p, r, 0]], ends])
                gained = np.concatenate([[-FAR * before[r, 0], 0.0], np.cumsum(moment[p, r] * length[p, r])])
                passed = np.interp(np.concatenate([begin[p, r, :1], ends]) - late[p, r, 0], nodes, gained)
                out[p, r] = np.diff(passed) / np.maximum(length[p, r], 1e-12)
        return np.where(length > 1e-9, out, moment)
