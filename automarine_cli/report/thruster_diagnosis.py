"""Tables and the page of a diagnosed thruster map."""

from functools import partial

from automarine_cli.diagnosis.thruster_map import WELL_ABOVE, ThrusterDiagnosis
from automarine_cli.diagnosis.verdict import NAMED, NOTHING, SUSPECTED, UNEXPLAINED
from automarine_cli.report.diagnosis_report import regions_table
from automarine_cli.report.figures import thrusters as figures
from automarine_cli.report.sections import Content, Sections, sections
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.report.thruster_tables import cells
from automarine_cli.thrusters.family import ALPHA
from automarine_cli.thrusters.fit import Parameter

MOST_FAULTS = 8


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


def sentences(result: ThrusterDiagnosis) -> tuple[str, ...]:
    """Say the verdict, what is missing, what else it could be, what remains, and which data are faulty."""
    return (verdict_sentence(result), *_effects_in_words(result), _remains(result), *_faults(result))


def verdict_sentence(result: ThrusterDiagnosis) -> str:
    """Put the verdict in one sentence with its numbers."""
    names = " and ".join(effect.name for effect in result.effects)
    if result.verdict == NAMED:
        before, after = (number(result.percent(size), 3) for size in (result.cross.before, result.cross.after))
        scale = f"of full scale ({number(result.data.full_scale)} N)"
        return f"Named: {names}. The cross-validated error falls from {before} % to {after} % {scale}."
    if result.verdict == SUSPECTED:
        return f"Suspected, not named: {names}. {result.why}"
    if result.verdict == UNEXPLAINED:
        before, floor = number(result.gap.before, 3), number(result.gap.floor, 3)
        return f"Unexplained: the residual is {before} N, the noise level {floor} N. {result.why}"
    return f"Nothing is missing from the {result.given.form} map that these levels could show."


def _effects_in_words(result: ThrusterDiagnosis) -> list[str]:
    lines = []
    for effect in result.effects:
        sure = "above 99 %" if effect.confidence > 0.99 else f"{100 * effect.confidence:.0f} %"
        lines.append(f"{effect.name}: {effect.says} Confidence {sure} (p = {effect.p_value:.2g}).")
        lines += [
            f"Cannot be excluded: {rival.name} (weight {rival.confidence:.0%}). Told apart by {rival.split_by}."
            for rival in effect.few_rivals
        ]
    return lines


def _remains(result: ThrusterDiagnosis) -> str:
    gap = result.gap
    above = gap.after > WELL_ABOVE * gap.floor and result.verdict in (NAMED, NOTHING)
    more = " No other effect of the library closes what is above it." if above else ""
    return (
        f"What remains is {number(gap.after, 3)} N ({number(result.percent(gap.after), 2)} % of full scale) against "
        f"a noise level of {number(gap.floor, 3)} N, read from {result.floor_from}.{more}"
    )


def _faults(result: ThrusterDiagnosis) -> list[str]:
    lines = [fault.says for fault in result.faults[:MOST_FAULTS]]
    if len(result.faults) > MOST_FAULTS:
        lines.append(f"And {len(result.faults) - MOST_FAULTS} more stretches, see diagnosis.json.")
    if any(fault.kind == "faulty-stretch" for fault in result.faults):
        lines.append("Measure the faulty readings again; they have little weight in these fits.")
    return lines


def tables(result: ThrusterDiagnosis) -> tuple[Table, ...]:
    """Lay out the gap, the effects, the regions and the candidates, as far as there are any."""
    effects = [_effects(result)] if result.effects else []
    where = [regions_table(result.where.regions, "N")] if result.where.regions else []
    return (_gaps(result), *effects, *where, _candidates(result))


def _gaps(result: ThrusterDiagnosis) -> Table:
    """Before and after on levels fitted, held out, and by cross-validation."""
    gaps = {
        "fitted levels": result.gap, "held-out levels": result.held_out_gap, "cross-validation": result.cross,
    }  # fmt: skip
    rows = [
        (name, *[MISSING] * 5)
        if gap is None
        else (
            name, number(gap.before, 3), number(gap.after, 3),
            *(number(result.percent(size), 3) for size in (gap.before, gap.after)), number(gap.floor, 2),
        )
        for name, gap in gaps.items()
    ]  # fmt: skip
    notes = [
        "Before: the map's form refitted. After: with the effects that are named.",
        f"The map exactly as given is {number(result.given_rmse, 3)} N off on the fitted levels.",
    ]
    if result.held_out is None:
        notes.append("Too few levels to hold any out: cross-validation leaves each out in turn.")
    header = ("levels", "before [N]", "after [N]", "before [% of full scale]", "after [%]", "noise level [N]")
    title = "Gap between map and measurement (root mean square)"
    return Table(title, header, tuple(rows), notes=tuple(notes))


def _effects(result: ThrusterDiagnosis) -> Table:
    rows = [
        (effect.name, name, _estimate(value), f"{effect.confidence:.0%}")
        for effect in result.effects
        for name, value in effect.parameters.items()
    ]
    return Table("Effects", ("effect", "parameter", "estimate", "confidence"), tuple(rows))


def _candidates(result: ThrusterDiagnosis) -> Table:
    """Every effect that was tried in the first step, and what it alone would win."""
    first = result.search.steps[0]
    rows = tuple(
        (
            candidate.effect, candidate.where, number(candidate.gain, 3), f"{candidate.p_value:.3f}",
            number(result.percent(candidate.fit.rmse(held_out=True)), 3),
        )
        for candidate in sorted(first.candidates, key=lambda candidate: candidate.fit.rmse(held_out=True))
    )  # fmt: skip
    note = (
        f"Significance threshold: {number(first.threshold, 3)}, which chance reaches in {1000 * ALPHA:.0f} of 1000 "
        "maps without any effect; p is corrected for the number of candidates."
    )
    header = ("effect", "direction", "evidence gained", "p", "cross-validated error [% of full scale]")
    return Table("Candidates", header, rows, notes=(note,))


def markdown(result: ThrusterDiagnosis) -> str:
    """Write diagnosis.md: the page for a person."""
    regions = result.where.regions
    blocks = [
        "# Diagnosis of a thruster map", verdict_sentence(result),
        *(f"- {line}" for line in _effects_in_words(result)),
        *([_effects(result).to_markdown()] if result.effects else []),
        "## Where the gap is",
        regions_table(regions, "N").to_markdown() if regions else "Nowhere beyond chance.",
        "![Where the gap is](where.png)",
        "## Why", _candidates(result).to_markdown(), "![Why](why.png)",
        "## The gap before and after", _gaps(result).to_markdown(), "![Before and after](before_after.png)",
        "## What remains", _remains(result), *(f"- {line}" for line in _faults(result)),
    ]  # fmt: skip
    return "\n\n".join(block.strip() for block in blocks) + "\n"


def _estimate(value: Parameter) -> str:
    if value.value is None:
        return "beyond what was measured"
    if value.estimate is None:
        return number(value.value)
    low, high = value.estimate.ci95
    return f"{number(value.value)} [{number(low)}, {number(high)}] {value.unit}".rstrip()
