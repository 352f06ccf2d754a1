"""Points of a bollard test -> square law, chosen form and its parameters, both directions."""

from dataclasses import dataclass

import numpy as np

from automarine_cli.errors import FitError
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate
from automarine_cli.runs.command_range import usual_neutral
from automarine_cli.thrusters.fit import (
    FEWEST_LEVELS,
    Parameter,
    Side,
    amplitude_unit,
    parameters,
    sides_of,
    square_law,
)
from automarine_cli.thrusters.forms import SIDES, thrust_both_ways
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.points import Ints, Points, levels_of
from automarine_cli.thrusters.selection import FormScore, Selection, select_form

ROUNDING = 1e-12  # errors below this share of full scale are zero
MIXED = 0.2  # share of readings with thrust of either sign from which a direction is two directions
FAINT = 0.05  # thrust the wrong way that is smaller than this share of full scale is "none", not a sign error


@dataclass(frozen=True)
class Analysis:
    """What one set of points says of one thruster.

    `square` holds equation 2's coefficients by direction, `without` why a direction has none; `parameters`
    the chosen form's estimates by direction; `r2` and `rmse` [N] are the square law's over all points,
    weighted as in the fit.
    """

    points: Points
    n_unit: str
    full_scale: float
    square: dict[str, Estimate]
    without: dict[str, str]
    levels: dict[str, int]
    selection: Selection
    parameters: dict[str, dict[str, Parameter]]
    r2: float
    chosen_r2: float

    @property
    def law(self) -> FormScore:
        """The square law among the forms."""
        return next(score for score in self.selection.scores if score.form.name == "square")

    @property
    def chosen(self) -> FormScore:
        """The form that is used."""
        return self.selection.chosen

    @property
    def estimates(self) -> dict[tuple[str, str], Parameter]:
        """The chosen form's own parameters by name and direction."""
        return {(key, side): found[key] for side, found in self.parameters.items() for key in self.chosen.form.free}

    @property
    def map(self) -> ThrusterMap:
        """The chosen form as a map."""
        return ThrusterMap(self.chosen.form.name, *self.chosen.both_ways, self.n_unit, self.points.n_range)

    def fitted(self, n: Floats, square: bool = False) -> Floats:
        """Thrust [N] by the chosen form or the square law, shape of n; NaN in a direction that has no fit."""
        return thrust_both_ways(*(self.law if square else self.chosen).both_ways, n)

    def over_all(self, score: FormScore) -> float:
        """Root mean square error [N] of a form over all points, those that contradict their neighbours alike."""
        off = self.points.force - thrust_both_ways(*score.both_ways, self.points.n)
        return float(np.sqrt(np.nanmean(off**2)))

    def percent(self, value: float | None) -> float | None:
        """Newtons as a percentage of full scale."""
        if value is None:
            return None
        return 0.0 if value < ROUNDING * self.full_scale else 100.0 * value / self.full_scale


def analyse(
    points: Points,
    step: Ints | None,
    tare_stderr: float,
    n_unit: str,
    forced: str | None = None,
    where: str = "the logs",
) -> tuple[Analysis, dict[str, Side]]:
    """Fit both directions of `points` (one thruster, tared, flagged); `step` numbers the voltage steps, shape
    (P,).

    Raises FitError where no direction can be fitted: no thrust, thrust against the command, too few levels.
    """
    full_scale = points.full_scale
    if len(points) == 0 or full_scale == 0.0:
        raise FitError(
            f"{where}: every thrust is zero; expected pulls at several commands. "
            "Check that the force column is the load cell's"
        )
    sides = sides_of(points, step, tare_stderr)
    without = _refused_directions(sides, full_scale, where)
    sides = {name: side for name, side in sides.items() if name not in without}
    if not sides:
        raise FitError(
            f"{where}: no direction can be fitted ({'; '.join(without.values())}); expected at least "
            f"{FEWEST_LEVELS} different commands in one direction. Pull at more levels"
        )
    square = {name: square_law(side, amplitude_unit(n_unit)) for name, side in sides.items()}
    used = points.where(np.isin(np.sign(points.n), [0.0, *(side.sign for side in sides.values())]))
    zero = used.n == 0.0
    zero_squares = float(used.weight[zero] @ used.force[zero] ** 2)
    total = float(used.weight.sum())
    selection = select_form(sides, zero_squares, total, full_scale, forced)
    chosen = selection.chosen
    found = {
        name: parameters(side, chosen.form, chosen.curves[name], chosen.at_bound[name], n_unit)
        for name, side in sides.items()
    }
    mean = float(used.weight @ used.force) / total
    spread = float(used.weight @ (used.force - mean) ** 2) / total
    law = next(score for score in selection.scores if score.form.name == "square")
    levels = {name: len(np.unique(levels_of(side.magnitude))) for name, side in sides.items()}
    r2 = (1.0 - score.rmse**2 / spread for score in (law, chosen))
    return Analysis(points, n_unit, full_scale, square, without, levels, selection, found, *r2), sides


def _rests_above(side: Side) -> bool:
    """Whether all commands are far from zero and one of them gives no thrust."""
    thrust = np.abs(side.thrust)
    return bool(side.magnitude.min() > 0.5 * side.magnitude.max() and thrust.min() < FAINT * thrust.max())


def _refused_directions(sides: dict[str, Side], full_scale: float, where: str) -> dict[str, str]:
    """Why a direction has no fit. Raises FitError where thrust opposes the command."""
    without, against = {}, []
    for name, _ in SIDES:
        if name not in sides:
            without[name] = f"no {name} points"
            continue
        side = sides[name]
        count = len(np.unique(levels_of(side.magnitude)))
        ahead, astern = (np.mean(sign * side.thrust > FAINT * full_scale) for sign in (1.0, -1.0))
        if min(ahead, astern) > MIXED:
            raise FitError(
                f"{where}: commands of one sign push both ways; the control signal looks counted from its "
                'end, not from rest, or without its sign. Write n = { from = "NAME", subtract = REST } (a pulse width '
                'rests at about 1500), or n = { from = "NAME", sign_from = "COLUMN" } where another column says the '
                "direction, under [columns] in the --columns file"
            )
        if len(sides) == 1 and _rests_above(side):
            low, high = float(side.magnitude.min()), float(side.magnitude.max())
            rest = usual_neutral(low, high, float(side.magnitude[np.argmin(np.abs(side.thrust))]))
            raise FitError(
                f"{where}: commands go from {low:.4g} to {high:.4g} and the thruster gives nothing at {rest:.4g}; the "
                'control signal looks counted from its end, not from rest. Write n = { from = "NAME", subtract = '
                f"{rest:.4g} }} under [columns] in the --columns file"
            )
        mean = float((side.weight * side.magnitude**2) @ side.thrust / (side.weight @ side.magnitude**2))
        if count < FEWEST_LEVELS:
            without[name] = f"{count} {name} level{'s' if count > 1 else ''}, at least {FEWEST_LEVELS} needed"
        elif mean <= 0.0:
            if abs(mean) <= FAINT * full_scale:
                without[name] = f"no {name} thrust measured"
            else:
                against.append(name)
    served = [name for name in sides if name not in without]
    if against and set(against) == set(served):
        raise FitError(
            f"{where}: thrust has the opposite sign of the control signal; if ahead is logged as negative "
            'force, write force_N = { from = "NAME", sign = -1 } under [columns] in the --columns file'
        )
    if against:
        raise FitError(
            f"{where}: {against[0]} thrust has the sign of the other direction; it looks logged as a "
            'magnitude. Write force_N = { from = "NAME", sign_from = "COLUMN" } with a column that says the direction '
            "under [columns] in the --columns file, or give thrust astern a minus sign in the log"
        )
    return without
