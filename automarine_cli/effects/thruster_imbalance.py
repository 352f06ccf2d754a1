"""Two thrusters that are not as equal as their one map says: one pulls harder, ahead or astern."""

from automarine_cli.dofs import Dof
from automarine_cli.effects.base import MIXED, Commands, Effect, Floats, Parameter, Place

PARTS = ("port_ahead", "port_astern", "stbd_ahead", "stbd_astern")
"""Signals: what each thruster adds to the moment or force while it pushes that way, zero while it pushes the other."""


def each(commands: Commands) -> tuple[Floats, Floats]:
    """What port and starboard thruster give by their map, (R, M), in the unit of the moment or force."""
    port, port_astern, stbd, stbd_astern = (commands.signals[part] for part in PARTS)
    return port + port_astern, stbd + stbd_astern


def lacking_signal(signal: str, remedy: str = "") -> str:
    """What a run lacks without a signal that a model needs, and the remedy, for sentences."""
    if signal in PARTS:
        return "thruster commands n_port and n_stbd; log them, and give --thrusters MAP.json"
    return f"column {signal!r}, which the log lacks{remedy}"


class ThrusterImbalance(Effect):
    """Gains of the four parts whose mean is held: (1 + way)(1 +- ahead) and (1 - way)(1 +- astern), + for port.

    A gain common to all four is a scale of inertia and drag, which no log of the motion shows. Where the two always
    turn equally fast and opposite ways, only ahead - astern shows, as a thrust-asymmetry does.
    """

    name = "thruster-imbalance"
    place = Place.ACTUATOR
    parameters = (
        Parameter("ahead", "half the relative difference of port and starboard thrust, ahead", "1", -0.9, 0.9, 0.05),
        Parameter("astern", "half the relative difference of port and starboard thrust, astern", "1", -0.9, 0.9, 0.05),
        Parameter("way", "half the relative difference of thrust ahead and astern", "1", -0.9, 0.9, 0.05),
    )  # fmt: skip
    equation = "{f}_delivered = sum over thrusters of (1 +- way) (1 +- ahead or astern) {f}_i"
    says = "One thruster pushes harder than the other, or both push otherwise ahead and astern than their map says."
    reveals = "runs in which the thrusters are not driven equally: each alone, ahead and astern"
    mistaken_for = ("thrust-asymmetry", "bias-moment", "drag-asymmetry")
    separated_by = "a run with each thruster alone, ahead and astern"
    source = "two thrusters of one map: equations 2 and 3 of Stipanov et al. (2007)"
    parity = MIXED
    needs = PARTS
    logged = ("n_port", "n_stbd")
    single = True

    def acts_in(self, dof: Dof) -> bool:
        return len(dof.thrusters) == 2

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        ahead, astern, way = values
        excess = (
            (1.0 + way) * (1.0 + ahead) - 1.0,
            (1.0 - way) * (1.0 + astern) - 1.0,
            (1.0 + way) * (1.0 - ahead) - 1.0,
            (1.0 - way) * (1.0 - astern) - 1.0,
        )
        return commands.force + sum(g * commands.signals[part] for g, part in zip(excess, PARTS))
