"""What `diagnose` shows of a model of one motion: the verdict in a sentence, tables, the page for a person, figures."""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import Diagnosis, MotionDiagnosis
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.diagnosis.residual_regions import SIZE, THRUST, Region, Where
from automarine_cli.diagnosis.search import LEVEL
from automarine_cli.diagnosis.study import JUDGED, Study
from automarine_cli.diagnosis.verdict import (
    EVEN,
    NAMED,
    SUSPECTED,
    UNEXPLAINED,
    WELL_ABOVE,
    Gap,
    NamedEffect,
    base_estimates,
)
from automarine_cli.dofs import Dof
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.estimate import Estimate
from automarine_cli.fits.innovations import fit_sentences
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.report.figures.diagnosis import before_after_figure, learned_figure, where_figure, why_figure
from automarine_cli.report.sections import Content, Sections, numbers, sections
from automarine_cli.report.tables import MISSING, Table, code_again, interval, number
from automarine_cli.runs.run import command_warnings

OF = {"moment": "a moment", "gain": "a gain", "drag": "linear drag"}
"""Kinds of learned curves in words."""
PLANNED = "`automarine plan MODEL --diagnosis diagnosis.json` plans the runs that separate them."
"""Where advice on rivals leads."""
FALLS = 0.02
"""Share of the noise by which a gap has to fall for that to be told."""
LARGE_MOVE = 2.0
"""A base parameter that moved by more than this many of its standard errors had been absorbing something."""
MOST_REGIONS = 8
MOST_NAMED_RUNS = 5


@sections.register
def _(result: MotionDiagnosis) -> Sections:
    diagnosis = result.diagnosis
    lines = [f"Warning: {warning}" for warning in command_warnings(diagnosis.study.runs)]
    lines.append(verdict_sentence(diagnosis))
    for effect in diagnosis.effects:
        lines.append(f"{effect.name}: {effect.says}")
        lines += [
            f"Cannot be excluded: {rival.name} (weight {rival.confidence:.0%}). Told apart by {rival.split_by}."
            for rival in effect.few_rivals
        ]
        lines += filter(None, [effect.other_rivals])
    if any(effect.rivals for effect in diagnosis.effects):
        lines.append(PLANNED)
    if diagnosis.study.cycle is not None:
        lines.append(diagnosis.study.cycle.sentence(result.stored.dof))
    lines += fit_sentences(diagnosis.channels, diagnosis.found.final.fit, result.stored.dof)
    files: dict[str, Content] = {
        "diagnosis.json": result.to_json(),
        "extended_model.json": result.extended_model(),
        "diagnosis.md": page(diagnosis),
    }
    figures = {
        "where": partial(where_figure, diagnosis),
        "why": partial(why_figure, diagnosis),
        "before_after": partial(before_after_figure, diagnosis),
    }
    for curve in (effect.learned for effect in diagnosis.effects if effect.learned is not None):
        figures["learned"] = partial(learned_figure, diagnosis, curve)
    rows = [
        {"effect": effect.name, "confidence": effect.confidence, "parameter": name, **numbers(estimate)}
        for effect in diagnosis.effects
        for name, estimate in effect.parameters.items()
    ]
    listed = (*files, *(f"{name}.png" for name in figures))
    return Sections([*lines, *tables(diagnosis)], files, figures, listed, rows)


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence with its numbers."""
    dof = diagnosis.study.base.dof
    unit, position = dof.units.shown, dof.words.position
    before, after, floor = headline_gap(diagnosis)
    counted = diagnosis.found.final.counted
    names = " and ".join(_or_rivals(effect) for effect in diagnosis.effects if effect.name in counted)
    if drag := [effect.name for effect in diagnosis.effects if effect.name not in counted]:
        names += f", where {' and '.join(drag)} puts the drag of the base right"
    gains = gains_instead(diagnosis)
    noise = f"noise of the {position} {floor} {unit}"
    gap = "gap" if not diagnosis.study.driven else f"error of predictions {JUDGED:g} s ahead"
    gap += of_held_out(diagnosis)
    said = diagnosis.said
    if said.word == NAMED:
        falls = gains or f"the {gap} falls from {before} to {after} {unit} ({_beside(diagnosis, noise)})"
        return f"Named: {names}; {falls}. {said.left}".strip()
    if said.word == SUSPECTED:
        return f"Suspected, not named: {names}. {said.why}"
    if said.word == UNEXPLAINED:
        return f"Unexplained: the {gap} is {before} {unit} ({_beside(diagnosis, noise)}). {said.why}"
    if diagnosis.study.driven:
        return (
            f"Nothing missing that these runs could show beside their disturbances: {gap} {before} {unit} "
            f"({_beside(diagnosis, noise)})."
        )
    return f"Nothing missing that these runs could show: {gap} {before} {unit}, {noise}."


def headline_gap(diagnosis: Diagnosis) -> tuple[str, str, str]:
    """The gap before and after and the noise, as people see them: of the runs held out, where there are some."""
    gap, outlook = diagnosis.gap, diagnosis.outlook
    if diagnosis.held_out_gap is not None:
        gap, outlook = diagnosis.held_out_gap, diagnosis.held_out_outlook
    judged = None if outlook is None else outlook.judged
    sizes = (gap.before, gap.after) if judged is None else (judged.before, judged.after)
    before, after, floor = (f"{diagnosis.study.base.dof.shown(x):.2f}" for x in (*sizes, gap.floor))
    return before, after, floor


def of_held_out(diagnosis: Diagnosis) -> str:
    """Which runs a gap is of, where some were held out."""
    runs = 0 if diagnosis.held_out is None else len(diagnosis.held_out.runs)
    return f" of the {runs} run{'s' * (runs > 1)} held out" if runs else ""


def _or_rivals(effect: NamedEffect) -> str:
    """An effect's name; of one that is less likely than its rivals together those too."""
    rivals = effect.few_rivals if effect.confidence < EVEN else ()
    return " or ".join([effect.name, *(rival.name for rival in rivals)])


def gains_instead(diagnosis: Diagnosis) -> str:
    """What was gained where no gap could fall because each run's own gain had followed what was missing: the scatter of
    the thrust; empty elsewhere."""
    gap, found = diagnosis.gap, diagnosis.found
    before, after = (100.0 * trial.fit.factor(GAIN) for trial in (found.base, found.final))
    if diagnosis.study.driven or gap.before - gap.after > FALLS * gap.floor or after > 0.7 * before:
        return ""
    return (
        f"thrust differs from run to run by {after:.1f} % instead of {before:.1f} % (the gap stays at "
        f"{diagnosis.study.base.dof.shown(gap.after):.2f} {diagnosis.study.base.dof.units.shown}, which is noise)"
    )


def curve_cell(curve: LearnedCurve) -> str:
    """A curve in a cell: between which values it goes."""
    scale, unit = (100.0, "%") if curve.kind == "gain" else (1.0, curve.y_unit)
    low, high = scale * curve.y.min(), scale * curve.y.max()
    return f"{low:+.3g} to {high:+.3g} {unit} over {number(curve.x[0], 3)} to {number(curve.x[-1], 3)}"


def _beside(diagnosis: Diagnosis, noise: str) -> str:
    """What the gap is to be compared with: the noise, and of driven runs what constants miss by."""
    outlook = diagnosis.outlook if diagnosis.held_out_gap is None else diagnosis.held_out_outlook
    judged = None if outlook is None else outlook.judged
    if judged is None:
        return noise
    dof = diagnosis.study.base.dof
    rate, still = (f"{dof.shown(x):.2f}" for x in (judged.constant_rate, judged.constant))
    return (
        f"a constant {dof.words.speed} misses by {rate} and a constant {dof.words.position} by {still} "
        f"{dof.units.shown}, {noise}"
    )


def outlook_table(diagnosis: Diagnosis) -> Table | None:
    """Errors of predictions by horizon, of runs fitted and held out; None of runs that are not driven."""
    dof, rows = diagnosis.study.base.dof, list[tuple[str, ...]]()
    unit, words = dof.units.shown, dof.words
    for name, outlook in (("fitted", diagnosis.outlook), ("held out", diagnosis.held_out_outlook)):
        for one in outlook.ahead if outlook is not None else ():
            sizes = (one.before, one.after, one.constant_rate, one.constant)
            rows.append((f"{name}, {one.horizon:g} s ahead", *(f"{dof.shown(size):.2f}" for size in sizes)))
    if not rows:
        return None
    return Table(
        "Predictions from the filtered state",
        ("runs", f"before [{unit}]", f"after [{unit}]", f"constant {words.speed} [{unit}]",
         f"constant {words.position} [{unit}]"),
        tuple(rows),
        notes=(
            "Root mean square errors; the filter knows the readings until each prediction begins, and the commands "
            "after it as they were logged.",
        ),
    )  # fmt: skip


def parameter_cell(effect: str, i: int, estimate: Estimate) -> str:
    """The estimate of an effect's parameter `i` with its interval; the word for a choice between laws."""
    parameter = effects.get(effect).parameters[i]
    return parameter.choices[round(estimate.value)] if parameter.choices else interval(estimate)


def counting(effect: str, parameters: Mapping[str, Estimate]) -> Iterator[tuple[int, str, Estimate]]:
    """Place, name and estimate of an effect's parameters, without those of laws that do not hold."""
    one, values = effects.get(effect), [estimate.value for estimate in parameters.values()]
    for i, (name, estimate) in enumerate(parameters.items()):
        if one.counts(one.parameters[i], values):
            yield i, name, estimate


def tables(diagnosis: Diagnosis) -> tuple[Table, ...]:
    """Effects with their parameters, gap, and the best candidates."""
    rows = [
        (effect.name, name, parameter_cell(effect.name, i, estimate), estimate.unit, f"{effect.confidence:.0%}")
        for effect in diagnosis.effects
        if effect.learned is None
        for i, name, estimate in counting(effect.name, effect.parameters)
    ]
    rows += [
        (effect.name, f"curve of {OF[effect.learned.kind]}", curve_cell(effect.learned), effect.learned.unit,
         f"{effect.confidence:.0%}")
        for effect in diagnosis.effects
        if effect.learned is not None
    ]  # fmt: skip
    found = diagnosis.found.rounds[0]
    best = sorted(found.trials, key=lambda trial: trial.evidence)[:5]
    evidence = Table(
        "Candidates", ("effect", "evidence gained"),
        tuple((trial.added[-1], number(found.gain(trial), 3)) for trial in best),
        notes=(
            f"Significance threshold: {number(found.threshold, 2)}, which chance reaches in {1000 * LEVEL:.0f} of "
            "1000 campaigns.",
        ),
    )  # fmt: skip
    named = Table("Effects", ("effect", "parameter", "estimate", "unit", "confidence"), tuple(rows))
    ahead = outlook_table(diagnosis)
    gaps = gap_table(diagnosis) if ahead is None else ahead
    return (*((named,) if rows else ()), gaps, evidence)


def page(diagnosis: Diagnosis) -> str:
    """Write the whole page in Markdown."""
    dof = diagnosis.study.base.dof
    sensors, ahead = (fit_sentences(diagnosis.channels, diagnosis.found.final.fit, dof), outlook_table(diagnosis))
    runs = f"{len(diagnosis.study.runs)} runs were fitted"
    if diagnosis.held_out is not None:
        runs += f" and {len(diagnosis.held_out.runs)} held out"
    verdict = f"{verdict_sentence(diagnosis)} {runs}."
    parts = [f"# Diagnosis of the {dof.name} model", escape(verdict), escape(" ".join(sensors))]
    for effect in diagnosis.effects:
        parts += [f"## {effect.name}", _effect(diagnosis, effect)]
    parts += ["## Where the gap is", _where(diagnosis.where), "![Where the gap is](where.png)"]
    parts += ["## Why", _why(diagnosis), "![Why](why.png)"]
    parts += ["## What it does to the model", _moves(diagnosis)]
    parts += [
        "## The gap before and after",
        gap_table(diagnosis).to_markdown(),
        "" if ahead is None else ahead.to_markdown(),
        "![Before and after](before_after.png)",
    ]
    parts += ["## What remains", _remains(diagnosis)]
    parts += ["## What to run next", _next(diagnosis)]
    if diagnosis.verdict != NAMED:
        parts += ["## What these runs would have shown", detectable_table(diagnosis).to_markdown()]
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def escape(text: str) -> str:
    """Text that came from a file, on one line, without meaning to Markdown or HTML."""
    return code_again(re.sub(r"([\\`*_{}\[\]<>#|!])", r"\\\1", " ".join(text.split())))


def _effect(diagnosis: Diagnosis, effect: NamedEffect) -> str:
    """One effect: equation, parameters, how sure, rivals, source."""
    card = effects.get(effect.name).card(diagnosis.study.base.dof)
    means = {parameter.name: parameter.meaning for parameter in card.parameters}
    table = Table(
        "", ("parameter", "meaning", "estimate and 95 % interval", "unit"),
        tuple(
            (name, means[name], parameter_cell(effect.name, i, e), e.unit or MISSING)
            for i, name, e in counting(effect.name, effect.parameters)
        ),
    )  # fmt: skip
    smallest = 1.0 / (1 + len(diagnosis.found.rounds[0].scores.null))
    chance = "at most" if effect.p_value <= 1.01 * smallest else "about"
    sure = (
        f"Chance alone would gain as much in {chance} {100 * effect.p_value:.2g} of 100 campaigns like "
        f"this one. Confidence that it is this effect: {effect.confidence:.0%}."
    )
    if not effect.rivals:
        sure += " No other effect of the library fits nearly as well."
    law = effects.get(effect.name).law_at([e.value for e in effect.parameters.values()])
    told = table.to_markdown() if effect.learned is None else ""  # the knots of a curve are in the file
    lines = [effect.says, f"`{diagnosis.study.base.dof.fill(law.equation)}`", *filter(None, [told]), sure]
    for rival in effect.few_rivals:
        lines.append(
            f"- {rival.name} cannot be excluded ({rival.confidence:.0%}). Told apart by {escape(rival.split_by)}."
        )
    lines += filter(None, [effect.other_rivals])
    if effect.learned is not None:
        lines += ["![What was learned](learned.png)", "The curve as a table is in diagnosis.json, under `learned`."]
    return "\n\n".join([*lines, f"Source: {law.source}."])


def _where(where: Where) -> str:
    """The regions as a table."""
    if not where.regions:
        return (
            f"The error depends on none of the {len(where.variables)} variables beyond chance (what whole runs, "
            "mirrored or exchanged at random, would show)."
        )
    rest = len(where.regions) - MOST_REGIONS
    table = regions_table(where.regions, where.dof.units.shown, where.dof.words.force)
    return table.to_markdown() + (f"\n{rest} more regions are in diagnosis.json." if rest > 0 else "")


def _why(diagnosis: Diagnosis) -> str:
    """Evidence of the best candidates."""
    first = diagnosis.found.rounds[0]
    best = sorted(first.trials, key=lambda trial: trial.evidence)[:5]
    driven = diagnosis.study.driven
    how = "the innovations of a filter, disturbances with it" if driven else "simulating whole runs"
    table = Table(
        "", ("candidate added to the base model", "evidence gained [deviance]"),
        tuple((trial.added[-1], number(first.gain(trial), 3)) for trial in best),
        notes=(
            f"Significance threshold: {number(first.threshold, 2)}, which chance reaches in {1000 * LEVEL:.0f} of 1000 "
            "campaigns. "
            f"Every candidate was fitted together with the base model by {how}.",
        ),
    )  # fmt: skip
    cycle = diagnosis.study.cycle
    told = [cycle.sentence(diagnosis.study.base.dof)] if cycle is not None else []
    return "\n\n".join(filter(None, [table.to_markdown(), " ".join([*told, *filter(None, [diagnosis.found.crowd])])]))


def _moves(diagnosis: Diagnosis) -> str:
    """Base parameters before and after."""
    dof = diagnosis.study.base.dof
    before = base_estimates(diagnosis.study, diagnosis.found.base)
    if diagnosis.verdict != NAMED:
        table = Table(
            "", ("parameter", "estimate and 95 % interval", "unit"),
            tuple((_called(name, dof), interval(e), e.unit) for name, e in before.items()),
        )  # fmt: skip
        return "Nothing was added; the base model fitted to these runs is\n\n" + table.to_markdown()
    after = base_estimates(diagnosis.study, diagnosis.found.final)
    rows, moved = [], []
    for name, old in before.items():
        new = after[name]
        change = (new.value - old.value) / old.value if abs(old.value) > 1e-6 * abs(new.value) else float("nan")
        rows.append(
            (
                _called(name, dof),
                interval(old),
                interval(new),
                f"{change:+.1%}" if np.isfinite(change) else MISSING,
                new.unit,
            )
        )
        if abs(new.value - old.value) > LARGE_MOVE * float(np.hypot(old.stderr, new.stderr)):
            moved.append(_called(name, dof))
    table = Table("", ("parameter", "base model", "with what was missing", "change", "unit"), tuple(rows))
    said = (
        f"{' and '.join(moved)} moved by more than the uncertainty: the base model had absorbed part of "
        "what is missing."
        if moved
        else "No base parameter moved by more than its uncertainty."
    )
    anew = f"The base model is fitted anew to these {len(diagnosis.study.runs)} runs: it is not quite that of the file."
    return table.to_markdown() + "\n" + f"{said} {anew}"


def _called(name: str, dof: Dof) -> str:
    """A base parameter as people call it."""
    own = dof.symbols
    return {own.constant: "constant force", own.difference: "half the difference of drag"}.get(name, name)


def _remains(diagnosis: Diagnosis) -> str:
    gap, dof = diagnosis.gap, diagnosis.study.base.dof
    position = dof.words.position
    if diagnosis.study.driven:
        return (
            f"Predictions {JUDGED:g} s ahead still miss by {dof.shown(gap.after):.2g} {dof.words.units}: the rest "
            "is disturbances that are not logged, and what the model lacks."
        )
    ratio = gap.after / max(gap.floor, 1e-12)
    text = f"The remaining gap is {ratio:.2f} times the noise of the {position}."
    if ratio < 1.0 + WELL_ABOVE:
        return text + " That is the noise level: nothing more can be fitted to these runs."
    return text + " A residual remains that no candidate explains; see where.png."


def _next(diagnosis: Diagnosis) -> str:
    lines = [
        f"{rival.name} against {effect.name}: {escape(rival.split_by)}."
        for effect in diagnosis.effects
        for rival in effect.few_rivals
    ]
    if lines:
        lines.append(PLANNED)
    for effect in diagnosis.effects:
        reveals = effects.get(effect.name).card(diagnosis.study.base.dof).reveals
        lines.append(f"To see {effect.name} better: {reveals}.")
    return "\n".join(f"- {line}" for line in (*lines, *general_advice(diagnosis.study)))


def general_advice(study: Study) -> tuple[str, ...]:
    """List the kinds of runs that the campaign lacks, a sentence each."""
    coasts = reversals = 0
    for run in study.runs:
        pushed = np.sign(run.command)
        moving = np.flatnonzero(pushed)
        if len(moving) == 0:
            continue
        coasts += bool(np.any(pushed[moving[0] :] == 0) and len(run) - moving[-1] > 3.0 / run.sample_period)
        reversals += bool(np.any(pushed[moving] != pushed[moving[0]]))
    rests = sum(not np.any(run.command) for run in study.runs)
    starts = np.array([run.position[0] for run in study.runs])
    even = float(np.abs(np.exp(1j * starts).mean()))
    sides = {float(np.sign(run.command[run.command != 0].mean())) for run in study.runs if np.any(run.command)}
    dof = study.base.dof
    words, advice = dof.words, []
    if coasts < 2:
        advice.append("Add two coast-downs: they separate a dead-band from Coulomb drag and show thrust loss.")
    if reversals < 2:
        advice.append(f"Add two reversals at full {words.force}: lags, delay and swirl show most there.")
    if even > 0.7 and dof.wraps:
        advice.append(
            f"Start runs from other {words.position}s: a {words.sensor} and a current show only against "
            f"{words.position}."
        )
    if len(sides - {0.0}) < 2:
        advice.append(f"{words.move.capitalize()} {words.both_ways}: asymmetry and bias need the other sign.")
    if rests == 0:
        advice.append(
            f"Add one rest record of a minute: bias, current and {words.rate_sensor} drift show without any model."
        )
    if not set(study.signals) - set(PARTS):
        advice.append("Log the supply voltage: without it a sag can hardly be separated from drag.")
    return tuple(advice) or ("The campaign has every kind of run; more runs of the same kinds narrow the intervals.",)


def regions_table(regions: Sequence[Region], unit: str, force: str = "thrust") -> Table:
    """Lay out the regions that stand out, the most significant first; gaps in `unit`, `force` as people call it."""
    return Table(
        "", ("variable", "from", "to", "unit", f"gap [{unit}]", "share of the gap", "seen in", "p", "runs"),
        tuple(_region(region, force) for region in regions[:MOST_REGIONS]),
        notes=(
            "p is corrected for all bins and variables. Shares of different variables overlap: they are views of one "
            "gap.",
        ),
    )  # fmt: skip


def _region(region: Region, force: str) -> tuple[str, ...]:
    some = ", ".join(region.runs[:MOST_NAMED_RUNS])
    more = len(region.runs) - MOST_NAMED_RUNS
    runs = f"{some} and {more} more" if more > 0 else some or MISSING
    kinds = {force: f"missing {force}", THRUST: "each run's own thrust", SIZE: "size of each run's gap"}
    return (
        region.variable, number(region.low, 3), number(region.high, 3), region.unit or MISSING, number(region.gap, 3),
        f"{region.share:.0%}", kinds.get(region.seen_in, region.seen_in), number(region.p_value, 2), runs,
    )  # fmt: skip


def gap_table(diagnosis: Diagnosis) -> Table:
    """Root mean square gap before and after, against the noise, on runs fitted and held out."""
    dof = diagnosis.study.base.dof
    unit, position = dof.units.shown, dof.words.position
    rows = [_gap_row(f"{len(diagnosis.study.runs)} runs fitted", diagnosis.gap, dof)]
    if diagnosis.held_out is not None and diagnosis.held_out_gap is not None:
        rows.append(_gap_row(f"{len(diagnosis.held_out.runs)} runs held out", diagnosis.held_out_gap, dof))
    scatter = [100.0 * trial.fit.factor(GAIN) for trial in (diagnosis.found.base, diagnosis.found.final)]
    return Table(
        "",
        ("runs", f"before [{unit}]", f"after [{unit}]", f"noise of the {position} [{unit}]",
         "gap above the noise closed"),
        tuple(rows),
        notes=(
            f"Root mean square errors of {position}s predicted {JUDGED:g} s ahead from the filtered state."
            if diagnosis.study.driven
            else f"Root mean square over whole runs simulated from their start, with each run's own start {position}, "
            "thrust and switch instants. "
            f"Thrust differs from run to run by {scatter[0]:.1f} % before and {scatter[1]:.1f} % after.",
        ),
    )  # fmt: skip


def _gap_row(name: str, gap: Gap, dof: Dof) -> tuple[str, ...]:
    cells = (f"{dof.shown(x):.2f}" for x in (gap.before, gap.after, gap.floor))
    above = gap.before**2 - gap.floor**2
    visible = above > 0.02 * gap.floor**2
    closed = f"{np.clip((gap.before**2 - gap.after**2) / above, 0.0, 1.0):.0%}" if visible else MISSING
    return (name, *cells, closed)


def detectable_table(diagnosis: Diagnosis) -> Table:
    """Smallest size of each effect that would have been named four times in five."""
    rows = []
    for name, size in sorted(diagnosis.detectable.items()):
        base = diagnosis.study.base
        told = effects.get(name).card(base.dof, base.moment_unit).parameters[_sized(name)]
        rows.append((name, told.name, number(size, 2), told.unit or MISSING))
    return Table(
        "", ("effect", "parameter", "smallest size seen", "unit"), tuple(rows),
        notes=("Sizes that these runs detect with 80 % power, measured from the value at which the effect is off.",),
    )  # fmt: skip


def _sized(name: str) -> int:
    """Place of the parameter that says how large an effect is: the first that is not a shape and is fitted."""
    return next((i for i, p in enumerate(effects.get(name).parameters) if not p.scan and not p.held), 0)
