"""The vehicle that a specification simulates: in yaw, or in surge or heave."""

from dataclasses import dataclass
from typing import Literal

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import SettingError
from automarine_cli.simulation.checks import at_least_zero, positive


@dataclass(frozen=True)
class Vehicle:
    """The vehicle: inertia `I_r` [moment s²], drag `k_rr` [moment s²] and `k_r` [moment s]."""

    I_r: float
    k_rr: float = 0.0
    k_r: float = 0.0
    moment_unit: Literal["nu", "N m"] = "nu"

    def __post_init__(self) -> None:
        positive(self, "I_r")
        at_least_zero(self, "k_rr", "k_r")
        if self.k_r + self.k_rr == 0:
            raise SettingError("k_rr and k_r are both 0; expected a drag, or the vehicle never gets steady")

    @property
    def dof(self) -> Dof:
        """The motion that is simulated."""
        return YAW

    @property
    def terms(self) -> list[tuple[str, float]]:
        """Effects that the vehicle is made of, with their one value."""
        drag = (("quadratic-drag", self.k_rr), ("linear-drag", self.k_r))
        return [(name, value) for name, value in drag if value > 0]


@dataclass(frozen=True)
class ForceVehicle(Vehicle):
    """A vehicle in surge or heave: mass `I_r` [force s²/m], drag `k_rr` [force s²/m²] and `k_r` [force s/m].

    In a file these have the names of the motion, as `m_u`, `X_uu` and `X_u`. `half_difference` is half the quadratic
    drag ahead less that astern (down, up), `constant_force` [force] of heave is weight less buoyancy, positive down.
    """

    moment_unit: Literal["nu", "N"] = "nu"  # type: ignore[assignment]
    motion: Literal["surge", "heave"] = "surge"
    half_difference: float = 0.0
    constant_force: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.half_difference) >= max(self.k_rr, 1e-300):
            raise SettingError("half_difference is not below k_rr; expected a drag that brakes both ways")
        if self.constant_force and not self.dof.has_constant:
            raise SettingError('constant_force is of heave; elsewhere expected the effect "bias-moment"')

    @property
    def dof(self) -> Dof:
        """The motion that is simulated."""
        return DOFS[self.motion]

    @property
    def terms(self) -> list[tuple[str, float]]:
        """Effects that the vehicle is made of, with their one value."""
        more = (("bias-moment", self.constant_force), ("drag-asymmetry", self.half_difference))
        return [*super().terms, *((name, value) for name, value in more if value)]
