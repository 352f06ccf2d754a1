"""Two thrusters that are not as equal as their one map says: one pulls harder, forward or backward."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import MIXED, SINGLE, Commands, Effect, Floats, Parameter, Place

Gain = TypeVar("Gain", float, Floats)
PARTS = ("port_forward", "port_backward", "stbd_forward", "stbd_backward")
"""Signals: what each thruster adds to the moment or force while it pushes that way, zero while it pushes the other."""
ARM = "arm"
"""Signal of runs in the plane: how far off the centre line both thrusters are [m]."""


def each(commands: Commands) -> tuple[Floats, Floats]:
    """What port and starboard thruster give by their map, (R, M), in the unit of the moment or force."""
    port, port_back, stbd, stbd_back = (commands.signals[part] for part in PARTS)
    return port + port_back, stbd + stbd_back


def acts_singly(effect: Effect, values: Sequence[float] = ()) -> bool:
    """Whether an effect acts on each of two thrusters, at these values."""
    return {*PARTS} <= {*effect.needs_at(tuple(values))}


def lacking_signal(signal: str, remedy: str = "") -> str:
    """What a run lacks without a signal that a model needs, and the remedy, for sentences."""
    if signal in (*PARTS, ARM):
        return "thruster commands n_port and n_stbd; log them, and give --thrusters MAP.json"
    name = {"voltage": "voltage_V", "surge": "surge_m_s", "sway": "sway_m_s", "heave": "heave_m_s"}.get(signal, signal)
    return f"column {name}, which the log lacks{remedy}"


class SingleThrusterEffect(Effect):
    """What acts on each of two thrusters, from their commands and their map."""

    place = Place.ACTUATOR
    needs = PARTS
    logged = ("n_port", "n_stbd")
    stage = SINGLE

    def acts_in(self, dof: Dof) -> bool:
        return len(dof.thrusters) == 2


class AheadOf(Effect):
    """What an effect of single thrusters that turn a vehicle makes of the force ahead that they give together."""

    name = "ahead"
    place = Place.ACTUATOR

    def __init__(self, of: Effect) -> None:
        self.of, self.stage = of, of.stage

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        arm = float(commands.signals[ARM].max())  # of a run's last steps there is none
        parts = {part: commands.signals[part] * (-1.0 if part.startswith("stbd") else 1.0) for part in PARTS}
        force, before = arm * commands.force, arm * commands.before
        as_moment = replace(commands, force=force, before=before, signals={**commands.signals, **parts})
        return self.of.deliver(as_moment, values) / arm


class ThrusterImbalance(SingleThrusterEffect):
    """Gains of the four parts whose mean is held: (1 + direction)(1 +- forward), (1 - direction)(1 +- backward), + for
    port.

    A gain common to all four is a scale of inertia and drag, which no log of the motion shows. Where the two always
    turn equally fast and opposite ways, only forward - backward shows, as a thrust-asymmetry does.
    """

    name = "thruster-imbalance"
    parameters = (
        Parameter("forward", "half the relative difference of the two thrusters, forward", "1", -0.9, 0.9, 0.05),
        Parameter("backward", "half the relative difference of the two thrusters, backward", "1", -0.9, 0.9, 0.05),
        Parameter("direction", "half the relative difference of forward and backward thrust", "1", -0.9, 0.9, 0.05),
    )  # fmt: skip
    equation = "{f}_delivered = sum of (1 +- direction) (1 +- forward or backward) {f}_i"
    says = "One thruster pushes harder than the other, or both push otherwise each way than their map says."
    reveals = "runs in which the thrusters are not driven equally: each alone, forward and backward"
    mistaken_for = ("thrust-asymmetry", "bias-moment", "drag-asymmetry")
    separated_by = "a run with each thruster alone, forward and backward"
    source = "two thrusters of one map: equations 2 and 3 of Stipanov et al. (2007)"
    parity = MIXED

    @staticmethod
    def gains(forward: Gain, backward: Gain, direction: Gain) -> tuple[Gain, Gain, Gain, Gain]:
        """Return what is delivered of each of PARTS, as a share of what the map says."""
        ahead, astern = 1.0 + direction, 1.0 - direction
        return ahead * (1.0 + forward), astern * (1.0 + backward), ahead * (1.0 - forward), astern * (1.0 - backward)

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        return commands.force + sum((g - 1.0) * commands.signals[p] for g, p in zip(self.gains(*values), PARTS))
