"""The vehicle that a specification simulates, in one degree of freedom, under the names of that motion."""

from dataclasses import dataclass, field

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import FILLER, key_of, keyed, told
from automarine_cli.simulation.checks import at_least_zero, positive


@dataclass(frozen=True)
class Vehicle:
    """The vehicle: inertia [force s², of a translation per metre], `quadratic` [force s²] and `linear` drag [force s].

    In a file they have the names of the motion: `I_r`, `k_rr` and `k_r`, or `m_u`, `X_uu` and `X_u`; the unit of force
    is `moment_unit` or `force_unit`.
    """

    inertia: float = field(metadata=keyed("{inertia_symbol}"))
    quadratic: float = field(default=0.0, metadata=keyed("{quadratic}"))
    linear: float = field(default=0.0, metadata=keyed("{linear}"))
    force_unit: str = field(default="nu", metadata=keyed("{force}_unit"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        positive(self, "inertia")
        at_least_zero(self, "quadratic", "linear")
        if self.force_unit not in self.dof.units.forces:
            raise SettingError(
                f"{key_of(self, 'force_unit')}: expected one of {', '.join(map(repr, self.dof.units.forces))}, "
                f"found {told(self.force_unit)}"
            )
        if self.linear + self.quadratic == 0:
            both = f"{key_of(self, 'quadratic')} and {key_of(self, 'linear')}"
            raise SettingError(f"{both} are both 0; expected a drag, or the vehicle never gets steady")

    @property
    def terms(self) -> list[tuple[str, float]]:
        """Effects that the vehicle is made of, with their one value."""
        drag = (("quadratic-drag", self.quadratic), ("linear-drag", self.linear))
        return [(name, value) for name, value in drag if value > 0]

    @property
    def constant(self) -> float:
        """The force that always acts."""
        return sum(value for name, value in self.terms if name == "bias-moment")


@dataclass(frozen=True)
class TranslatingVehicle(Vehicle):
    """A vehicle that moves along one of its axes: `motion` is which.

    `difference` is half the quadratic drag one way less that the other way, the positive way first; `constant_force`
    [force] is weight less buoyancy where that acts, positive down.
    """

    motion: str = ""
    difference: float = field(default=0.0, metadata=keyed("{difference}"))
    constant_force: float = field(default=0.0, metadata=keyed("{constant}"))

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.difference) >= max(self.quadratic, 1e-300):
            one, other = key_of(self, "difference"), key_of(self, "quadratic")
            raise SettingError(f"{one} is not below {other}; expected a drag that brakes both ways")
        if self.constant_force and not self.dof.has_constant:
            those = " and ".join(one.name for one in DOFS.values() if one.has_constant)
            raise SettingError(
                f'{key_of(self, "constant_force")} is of {those}; elsewhere expected the effect "bias-moment"'
            )

    @property
    def terms(self) -> list[tuple[str, float]]:
        """Effects that the vehicle is made of, with their one value."""
        more = (("bias-moment", self.constant_force), ("drag-asymmetry", self.difference))
        return [*super().terms, *((name, value) for name, value in more if value)]
