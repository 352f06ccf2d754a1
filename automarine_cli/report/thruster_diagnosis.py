"""Tables and the page of a diagnosed thruster map: what was wrong, how sure, what it does, what remains, what next."""

from functools import partial

from automarine_cli.report.figures import thruster_diagnosis as figures
from automarine_cli.report.sections import Content, Sections, sections
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.report.thruster_tables import cells
from automarine_cli.thrusters.diagnosis import ThrusterDiagnosis
from automarine_cli.thrusters.fit import Parameter
from automarine_cli.thrusters.verdict import WELL_ABOVE

SHOWN = 8
SEEN = {
    "dead-band": "a dead-band of {} in n",
    "thrust-exponent": "an exponent {} off",
    "saturation": "a saturation over the last {} of the range",
    "thrust-asymmetry": "an asymmetry of {}",
    "voltage-exponent": "a voltage exponent of {}",
    "battery-sag": "a sag of {} over the measurement",
}
"""How the smallest size that would have been seen is said."""
VARIABLE = {"n": "control signal", "voltage": "voltage", "run-order": "run order"}


@sections.register
def _(result: ThrusterDiagnosis) -> Sections:
    drawn = {
        "where": partial(figures.where_figure, result),
        "why": partial(figures.why_figure, result),
        "before_after": partial(figures.before_after_figure, result),
    }
    files: dict[str, Content] = {
        "diagnosis.json": result.to_json(),
        "extended_model.json": result.extended_map,
        "diagnosis.md": markdown(result),
    }
    rows = [
        {"effect": effect.name, "confidence": effect.confidence, "parameter": name, **cells(parameter)}
        for effect in result.effects
        for name, parameter in effect.parameters.items()
    ]
    listed = (*files, *(f"{name}.png" for name in drawn))
    return Sections([*sentences(result), *tables(result)], files, drawn, listed, rows)


def tables(result: ThrusterDiagnosis) -> tuple[Table, ...]:
    """All tables that the result has something for, in the order of reading."""
    found = [gaps(result)]
    if result.effects:
        found.append(effects(result))
    if result.where:
        found.append(where(result))
    return (*found, candidates(result))


def sentences(result: ThrusterDiagnosis) -> tuple[str, ...]:
    """The verdict, how sure it is, what remains, faulty data, and what to measure next."""
    said = [verdict_sentence(result)]
    said += [f"{effect.says} {sure(effect.confidence)}." for effect in result.effects]
    said.append(remains(result))
    said += [fault.says for fault in result.faults[:SHOWN]]
    if len(result.faults) > SHOWN:
        said.append(f"And {len(result.faults) - SHOWN} more stretches, see diagnosis.json.")
    return (*said, *advice(result))


def verdict_sentence(result: ThrusterDiagnosis) -> str:
    """The verdict in one sentence with its numbers."""
    share = result.percent
    if result.verdict == "named":
        names = listed([effect.name for effect in result.effects])
        return (
            f"Named: {names}. The cross-validated error falls from {number(share(result.cross.before), 3)} % to "
            f"{number(share(result.cross.after), 3)} % of full scale ({number(result.data.full_scale)} N)."
        )
    if result.verdict == "nothing-missing":
        seen = [
            SEEN[name].format(number(size, 2)) for name, size in sorted(result.smallest.items()) if size is not None
        ]
        limit = f" These levels would have shown {listed(seen)}." if seen else ""
        return f"Nothing is missing from the {result.given.form} map that these levels could show.{limit}"
    near = f" It resembles {result.closest} most, which does not explain it." if result.closest else ""
    return (
        f"Unexplained: residuals of {number(result.gap.before, 3)} N are well above the noise level of "
        f"{number(result.gap.floor, 3)} N and are correlated along the control signal, and no effect "
        f"explains them.{near}"
    )


def sure(confidence: float) -> str:
    """How sure, in words that claim no more than a percent."""
    return "Confidence above 99 %" if confidence > 0.99 else f"Confidence {100 * confidence:.0f} %"


def listed(names: list[str]) -> str:
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def remains(result: ThrusterDiagnosis) -> str:
    """What is left over the noise level."""
    gap = result.gap
    above = gap.after > WELL_ABOVE * gap.floor and result.verdict != "unexplained"
    more = " No other effect of the library closes what is above it." if above else ""
    return (
        f"What remains is {number(gap.after, 3)} N ({number(result.percent(gap.after), 2)} % of full scale) against "
        f"a noise level of {number(gap.floor, 3)} N, read from {result.floor_from}.{more}"
    )


def advice(result: ThrusterDiagnosis) -> tuple[str, ...]:
    """The pulls that would split rivals, or measure again what is not to be trusted."""
    said = [
        f"{rival.name} cannot be excluded as an alternative to {effect.name} ({100 * rival.confidence:.0f} %). "
        f"{rival.split_by}"
        for effect in result.effects
        for rival in effect.rivals
    ]
    if any(fault.kind == "faulty-stretch" for fault in result.faults):
        said.append("Measure the faulty readings again; they have little weight in these fits.")
    if result.verdict == "unexplained" and result.where:
        region = max(result.where, key=lambda one: one.gap)
        said.append(
            f"Repeat the pulls where the gap is largest, {VARIABLE[region.variable]} from {region.low:.4g} to "
            f"{region.high:.4g}, twice and in another order, to tell a curve of another form from a drift."
        )
    return tuple(said)


def gaps(result: ThrusterDiagnosis) -> Table:
    """Before and after on levels fitted, held out, and by cross-validation."""
    rows = []
    for name, gap in (
        ("fitted levels", result.gap),
        ("held-out levels", result.held_out_gap),
        ("cross-validation", result.cross),
    ):
        if gap is None:
            rows.append((name, *[MISSING] * 5))
            continue
        shares = (number(result.percent(value), 3) for value in (gap.before, gap.after))
        rows.append((name, number(gap.before, 3), number(gap.after, 3), *shares, number(gap.floor, 2)))
    notes = ["Before: the map's form refitted. After: with the effects that are named."]
    notes.append(f"The map exactly as given is {number(result.given_rmse, 3)} N off on the fitted levels.")
    if result.held_out is None:
        notes.append("Too few levels to hold any out: cross-validation leaves each out in turn.")
    return Table(
        "Gap between map and measurement (root mean square)",
        ("levels", "before [N]", "after [N]", "before [% of full scale]", "after [%]", "noise level [N]"),
        tuple(rows),
        notes=tuple(notes),
    )


def effects(result: ThrusterDiagnosis) -> Table:
    """What is missing, with parameters and how sure."""
    rows = []
    for effect in result.effects:
        for index, (name, value) in enumerate(effect.parameters.items()):
            first = (effect.name, f"{effect.confidence:.2f}", f"{effect.p_value:.3f}") if index == 0 else ("", "", "")
            rows.append((*first, name, _estimate(value)))
    return Table(
        "Effects that are missing from the map",
        ("effect", "confidence", "p", "parameter", "value [95 % interval]"),
        tuple(rows),
    )


def where(result: ThrusterDiagnosis) -> Table:
    """Regions in which the map as it was stands out from the measurement."""
    rows = tuple(
        (
            VARIABLE[one.variable], number(one.low), number(one.high), one.unit, number(one.gap, 3),
            f"{100 * one.share:.0f} %", f"{one.p_value:.3f}",
        )
        for one in result.where
    )  # fmt: skip
    return Table("Where the gap is significant", ("against", "from", "to", "unit", "gap [N]", "share", "p"), rows)


def candidates(result: ThrusterDiagnosis) -> Table:
    """Every effect that was tried in the first look, and what it alone would win."""
    look = result.search.rounds[0]
    trials = sorted(look.trials, key=lambda trial: trial.fit.rmse(left_out=True))
    rows = tuple(
        (
            trial.effect,
            trial.where,
            number(trial.evidence, 3),
            f"{trial.p_value:.3f}",
            number(result.percent(trial.fit.rmse(left_out=True)), 3),
        )
        for trial in trials
    )
    chance = number(look.scores.least_evidence, 3)
    note = (
        f"Significance threshold: an evidence of {chance}, which chance reaches in one of 100 maps without any effect."
    )
    header = ("effect", "direction", "evidence", "p", "cross-validated error [% of full scale]")
    return Table("Candidates alone", header, rows, notes=(note,))


def markdown(result: ThrusterDiagnosis) -> str:
    """diagnosis.md: a page for a person."""
    blocks = ["# Diagnosis of a thruster map", verdict_sentence(result)]
    blocks += [f"- {effect.says} {sure(effect.confidence)} (p = {effect.p_value:.3f})." for effect in result.effects]
    blocks += ["## What it does to the map", gaps(result).to_markdown().rstrip("\n")]
    blocks += [effects(result).to_markdown().rstrip("\n")] if result.effects else []
    blocks.append("![Before and after](before_after.png)")
    blocks += ["## Where the map goes wrong"]
    blocks += [where(result).to_markdown().rstrip("\n")] if result.where else ["Nowhere beyond chance."]
    blocks += ["![Where](where.png)", "## Why", candidates(result).to_markdown().rstrip("\n"), "![Why](why.png)"]
    blocks += ["## What remains, and what to measure next", remains(result)]
    blocks += [f"- {fault.says}" for fault in result.faults[:SHOWN]]
    blocks += [f"- {sentence}" for sentence in advice(result)]
    return "\n\n".join(blocks) + "\n"


def _estimate(one: Parameter) -> str:
    if one.value is None:
        return "beyond what was measured"
    if one.estimate is None:
        return number(one.value)
    low, high = one.estimate.ci95
    return f"{number(one.value)} [{number(low)}, {number(high)}] {one.unit}".rstrip()
