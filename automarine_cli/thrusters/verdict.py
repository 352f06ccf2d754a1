"""What a search on a thruster map is entitled to say: verdict, named effects with estimates, rivals, next pulls."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.fits.stepwise import NamedRival
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate
from automarine_cli.thrusters.fit import Parameter, parameters
from automarine_cli.thrusters.search import Rival, Search
from automarine_cli.thrusters.shapes import ASYMMETRY, SAG, VOLTAGE, Fitted, Shape, form_of, multiplier_columns

WELL_ABOVE = 1.5
"""Residual over the noise level from which a map may lack something; the floor itself is known to some 20 %."""
LEFT_OVER = 0.3
"""Share of the excess of squares over the floor that may stay when effects are named."""
MATERIAL = 0.005
"""Share of full scale below which what remains is not worth a verdict: bollard tests repeat no better."""
STRUCTURED = 0.01
THROWS = 999
PARAMETER = {"dead-band": "n_0", "thrust-exponent": "p", "saturation": "n_sat"}
WORDS = {
    "backward_over_forward": "thrust backward over forward at full command",
    "share_lost": "share lost from first to last reading",
}
SAYS = {
    "dead-band": "The thruster gives nothing below a smallest command",
    "thrust-exponent": "Thrust grows with another power of the command than the map's",
    "saturation": "Thrust stops rising above a largest command",
    ASYMMETRY: "The thruster pulls differently forward and backward",
    VOLTAGE: "Thrust at the same command follows the supply voltage",
    SAG: "Thrust falls over the measurement, as with a battery that empties",
}


@dataclass(frozen=True)
class Named:
    """An effect missing from the map: sentence, parameters, how sure, p-value, rivals.

    A parameter at the end of its range has no interval.
    """

    name: str
    says: str
    parameters: Mapping[str, Parameter]
    confidence: float
    p_value: float
    rivals: tuple[NamedRival, ...]

    def to_json(self) -> dict[str, object]:
        """The contract's form."""
        return {
            "name": self.name,
            "says": self.says,
            "parameters": {key: value.to_json() for key, value in self.parameters.items()},
            "confidence": self.confidence,
            "p_value": self.p_value,
            "rivals": [vars(rival) for rival in self.rivals],
        }


def verdict_of(search: Search, floor: float, seed: int) -> str:
    """ "named", "nothing-missing" or "unexplained".

    Unexplained are residuals well above the floor that hang together along the command when what was added closes
    less than most of the excess: the best candidate then only fits least badly.
    """
    floor = max(floor, 1e-9 * search.base.data.full_scale)
    before, after = (max((fit.rmse() / floor) ** 2 - 1.0, 0.0) for fit in (search.base, search.final))
    well_above = search.final.rmse() > max(WELL_ABOVE * floor, MATERIAL * search.base.data.full_scale)
    if well_above and after > LEFT_OVER * before and hangs_together(search.final, seed) <= STRUCTURED:
        return "unexplained"
    return "named" if search.named else "nothing-missing"


def hangs_together(found: Fitted, seed: int) -> float:
    """p-value of neighbouring levels' residuals being alike: products of neighbours, against signs thrown."""
    data, random = found.data, np.random.default_rng(seed)
    step = np.zeros(len(data.points)) if data.step is None else data.step
    order = np.lexsort((data.points.n, np.sign(data.points.n), step))
    rest = (np.sqrt(data.points.weight) * found.residual)[order]
    together = rest[1:] * rest[:-1]
    signs = random.choice([-1.0, 1.0], size=(THROWS, len(together)))
    return float((1.0 + np.sum(signs @ together >= together.sum())) / (1.0 + THROWS))


def named_effects(search: Search, floor: float) -> tuple[Named, ...]:
    """The final model's effects, in the order in which they were found."""
    found = []
    for name in search.named:
        rivals = [rival for rival in search.rivals if rival.instead_of == name]
        total = 1.0 + sum(rival.odds for rival in rivals)
        p_value = search.p_values[name]
        values = effect_parameters(search.final, name, search.base)
        listed = tuple(
            NamedRival(rival.name, rival.odds / total * (1.0 - p_value), split_by(search.final, rival, floor))
            for rival in rivals
        )
        says = f"{SAYS[name]}: {_worded(values)}."
        found.append(Named(name, says, values, (1.0 - p_value) / total, p_value, listed))
    return tuple(found)


def effect_parameters(found: Fitted, effect: str, base: Fitted) -> dict[str, Parameter]:
    """Estimates of one effect; a parameter of one direction says so in its name."""
    data, result = found.data, dict[str, Parameter]()
    if effect in (VOLTAGE, SAG):
        shape = Shape(found.shape.curves, effect == VOLTAGE, effect == SAG)
        value = found.power if effect == VOLTAGE else found.sag
        column = multiplier_columns(found, shape)[:, 0]
        steps = data.step if effect == VOLTAGE else None
        estimate = Estimate.from_stderr(value, _one_stderr(found, column, steps), data.levels - 1, "1")
        return {"p" if effect == VOLTAGE else "share_lost": Parameter.of(estimate)}
    if effect == ASYMMETRY:
        sides = [np.where(data.points.n * sign > 0, found.predicted, 0.0) for sign in (1.0, -1.0)]
        ends = [found.along(np.array([sign * np.max(np.abs(data.points.n))]))[0] for sign in (1.0, -1.0)]
        ratio = float(abs(ends[1] / ends[0]))
        relative = float(np.hypot(_one_stderr(found, sides[0], None), _one_stderr(found, sides[1], None)))
        dof = min(int(np.count_nonzero(side)) for side in sides) - 1
        return {"backward_over_forward": Parameter.of(Estimate.from_log(ratio, relative, dof, "1"))}
    for where in found.shape.on(effect):
        if effect in dict(base.shape.curves).get(where, frozenset()):
            continue
        one = _curve_parameters(found)[where][PARAMETER[effect]]
        if not one.fixed:
            result[PARAMETER[effect] + ("" if where == "both" else f"_{where}")] = one
    return result


def _curve_parameters(found: Fitted) -> dict[str, dict[str, Parameter]]:
    """Estimates of every direction's curve ("both" where they share one), by parameter."""
    result = {}
    gain = found.gain(found.data)
    for name, (index, side) in found.data.parts(found.shape.tied).items():
        form, level = form_of(dict(found.shape.curves)[name]), side
        if found.power or found.sag:
            own = gain[index]
            level = replace(side, thrust=side.thrust / own, weight=side.weight * own**2)
        values = parameters(level, form, found.curves[name], found.at_bound[name], found.data.n_unit)
        result[name] = values
    return result


def curve_parameters(found: Fitted) -> dict[str, dict[str, Parameter]]:
    """Estimates of the curves forward and backward, as a map's file holds them."""
    values = _curve_parameters(found)
    return {"forward": values["both"], "backward": values["both"]} if found.shape.tied else values


def _one_stderr(found: Fitted, column: Floats, steps: np.ndarray | None) -> float:
    """Standard error of one parameter from its own derivative: by levels, or by voltage steps if that is more."""
    weight = found.data.points.weight
    squares = float(weight @ column**2)
    moment = weight * column * found.residual
    sizes = []
    for unit in (found.data.level, steps):
        if unit is not None:
            count = len(np.unique(unit))
            sums = np.array([moment[unit == number].sum() for number in np.unique(unit)])
            sizes.append(np.sqrt(np.sum(sums**2) * count / max(count - 1, 1)) / squares)
    return float(max(sizes))


def split_by(final: Fitted, rival: Rival, floor: float) -> str:
    """The pull at which the named effect and its rival differ most, from the two fitted models."""
    data = final.data
    n = data.points.n
    along = np.linspace(min(float(n.min()), 0.0), max(float(n.max()), 0.0), 801)
    gap = np.nan_to_num(final.along(along) - rival.fit.along(along))
    if SAG in (rival.name, rival.instead_of):
        return "Repeat the first command last: a sag shows as less thrust at the same command."
    if VOLTAGE in (rival.name, rival.instead_of):
        return "Repeat three commands at another voltage."
    if ASYMMETRY in (rival.name, rival.instead_of):
        return "Pull at the same commands forward and backward, five times each."
    at = int(np.argmax(np.abs(gap)))
    times = max(1, int(np.ceil((3.0 * max(floor, 1e-12) / max(abs(gap[at]), 1e-12)) ** 2)))
    often = "once" if times == 1 else f"{times} times"
    return (
        f"Pull {often} at n = {along[at]:.3g}: with {rival.instead_of} {final.along(along[[at]])[0]:.3g} N, with "
        f"{rival.name} {rival.fit.along(along[[at]])[0]:.3g} N, a difference of {abs(gap[at]):.2g} N."
    )


def _worded(values: Mapping[str, Parameter]) -> str:
    parts = []
    for name, value in values.items():
        text = "beyond what was measured" if value.value is None else f"{value.value:.3g}"
        parts.append(
            f"{WORDS.get(name, name.replace('_forward', ' forward').replace('_backward', ' backward'))} = {text}"
        )
    return ", ".join(parts)
