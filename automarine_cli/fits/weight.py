"""What weight and buoyancy do: the ballast of a vehicle that rises or sinks, and the swing of one that they turn back.

A swing I p' = -k p - k2 |p| p - G sin(phi) + b has the natural frequency omega_n = sqrt(G/I), the damping ratio
zeta = k/(2 sqrt(G I)), and over a swing of amplitude A the linear damping that takes as much energy,
zeta + 4 A k2/(3 pi I). G is m g GM, GM the metacentric height. Sources: Fossen (2021), Handbook of Marine Craft
Hydrodynamics and Motion Control, chapter 4; ITTC Recommended Procedure 7.5-02-07-04.5 (roll damping).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from automarine_cli.estimate import Estimate
from automarine_cli.fits.whole_runs import OutputErrorFit, run_dof
from automarine_cli.quantities import Floats

GRAVITY = 9.81  # m/s²; within 0.3 % of what it is anywhere
AMPLITUDE_DEG = 10.0  # at which linear and quadratic damping are summed up


@dataclass(frozen=True)
class Buoyancy:
    """The constant force of a model, positive down, told as what a diver would do about it."""

    force: Estimate

    @property
    def ballast(self) -> Estimate | None:
        """Mass [kg], weighed in water, that balances the vehicle; None for a normalised force."""
        return self.force.scaled(-1.0 / GRAVITY, "kg") if self.force.unit == "N" else None

    @property
    def says(self) -> str:
        low, high = self.force.ci95
        if low < 0 < high:
            return f"Buoyancy: not significant; the force is {low:.2g} to {high:.2g} {self.force.unit} down."

        def size(of: Estimate) -> str:
            low, high = sorted(map(abs, of.ci95))
            return f"{abs(of.value):.3g} {of.unit} [{low:.3g}, {high:.3g}]"

        way, action = ("up", "add") if self.force.value < 0 else ("down", "take off")
        text = f"Buoyancy: a constant force of {size(self.force)} {way}"
        if self.ballast is None:
            return f"{text}, in the unit of the command."
        return f"{text}: to balance it {action} {size(self.ballast)} of ballast, weighed in water."

    def to_json(self) -> dict[str, object]:
        ballast = self.ballast and self.ballast.to_json()
        return {"constant_force": self.force.to_json(), "ballast_in_water": ballast, "says": self.says}


@dataclass(frozen=True)
class Swing:
    """How a vehicle swings under one model. `damping_ratio` is that of linear drag and `quadratic_damping` drag over
    inertia [1/rad], None of a model without; `damped_period` None where it does not swing; `damping_at_amplitude` the
    damping ratio of all drag at AMPLITUDE_DEG; `rest_angle` [deg] the list or trim at which it rests;
    `gm_over_gyradius_squared` [1/m] the metacentric height over the square of the radius of gyration with added
    inertia; `metacentric_height` [m] None where mass or inertia are not known."""

    natural_period: Estimate
    damped_period: Estimate | None
    damping_ratio: Estimate | None
    quadratic_damping: Estimate | None
    damping_at_amplitude: Estimate
    rest_angle: Estimate
    gm_over_gyradius_squared: Estimate
    metacentric_height: Estimate | None

    def to_json(self) -> dict[str, object]:
        entries = {
            "natural_period_s": self.natural_period, "damped_period_s": self.damped_period,
            "damping_ratio": self.damping_ratio, "quadratic_damping_per_rad": self.quadratic_damping,
            f"damping_ratio_at_{AMPLITUDE_DEG:g}_deg": self.damping_at_amplitude, "rest_angle_deg": self.rest_angle,
            "GM_over_radius_of_gyration_squared_per_m": self.gm_over_gyradius_squared,
            "GM_m": self.metacentric_height,
        }  # fmt: skip
        return {key: estimate and estimate.to_json() for key, estimate in entries.items()}


SWING_ROLES = ("inertia", "restoring", "linear", "quadratic", "constant")


def swing_of(fit: OutputErrorFit, mass: float | None) -> Swing:
    """Return how the vehicle swings, by the delta method on the fit's covariance; `mass` [kg] if that is known and the
    fit is in newton metres."""
    dof, roles = fit.model.dof, fit.roles
    places = {role: fit.mixed.names.index(dof.parameter(role)) for role in roles}

    def of(size: Callable[[float, float, float, float, float], float], unit: str, log: bool = True) -> Estimate:
        """Give what `size` makes of inertia, restoring moment, linear, quadratic drag and constant moment."""

        def value(phi: Floats) -> float:
            theta = fit.mixed.parameters.natural(phi)
            result = size(*(float(theta[places[role]]) if role in places else 0.0 for role in SWING_ROLES))
            return math.log(max(result, 1e-12)) if log else result

        phi, errors = fit.mixed.phi, np.sqrt(np.maximum(np.diagonal(fit.covariance), 0.0))
        slope = np.zeros(len(phi))
        for i in np.flatnonzero(errors[: len(fit.model.theta)]):
            h = 1e-3 * errors[i] * (np.arange(len(phi)) == i)
            slope[i] = (value(phi + h) - value(phi - h)) / (2.0 * h[i])
        stderr = float(np.sqrt(max(float(slope @ fit.covariance @ slope), 0.0)))
        form, middle = Estimate.from_log if log else Estimate.from_stderr, value(phi)
        return form(math.exp(middle) if log else middle, stderr, run_dof(fit.mixed, slope), unit)

    amplitude = math.radians(AMPLITUDE_DEG)

    def damping(i: float, g: float, k: float) -> float:
        return k / (2.0 * math.sqrt(i * g))

    linear = of(lambda i, g, k, k2, b: damping(i, g, k), "1", log=False) if "linear" in roles else None
    ratio = linear.value if linear else 0.0
    return Swing(
        of(lambda i, g, k, k2, b: 2.0 * math.pi * math.sqrt(i / g), "s"),
        of(lambda i, g, k, k2, b: 2.0 * math.pi * math.sqrt(i / g / (1.0 - damping(i, g, k) ** 2)), "s")
        if abs(ratio) < MAX_DAMPING else None,
        linear,
        of(lambda i, g, k, k2, b: k2 / i, "1/rad") if "quadratic" in roles else None,
        of(lambda i, g, k, k2, b: damping(i, g, k) + 4.0 * amplitude * k2 / (3.0 * math.pi * i), "1", log=False),
        of(lambda i, g, k, k2, b: math.degrees(math.asin(min(max(b / g, -1.0), 1.0))), "deg", log=False),
        of(lambda i, g, k, k2, b: g / i / GRAVITY, "1/m"),
        None if mass is None else of(lambda i, g, k, k2, b: g / (mass * GRAVITY), "m"),
    )  # fmt: skip


MAX_DAMPING = 0.99  # damping ratio from which on nothing swings
