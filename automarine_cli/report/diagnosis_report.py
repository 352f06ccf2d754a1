"""What `diagnose` shows of a model of one motion, of the plane or of a thruster map: the verdict in a sentence, tables,
the page for a person, figures."""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis import thruster_map
from automarine_cli.diagnosis.diagnose import (
    EVEN,
    NAMED,
    NOTHING,
    SUSPECTED,
    UNEXPLAINED,
    WELL_ABOVE,
    Diagnosis,
    Gap,
    MotionDiagnosis,
    NamedEffect,
    Outlook,
    base_estimates,
)
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.diagnosis.planar import HEAD_START, PlanarDiagnosis, PlanarSearch, judged
from automarine_cli.diagnosis.residual_regions import SIZE, THRUST, Region
from automarine_cli.diagnosis.search import LEVEL
from automarine_cli.diagnosis.study import JUDGED, Study
from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis
from automarine_cli.dofs import YAW, Dof
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.fits.innovations import fit_sentences
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.report.figures import diagnosis as figures
from automarine_cli.report.sections import Content, Sections, bullets, document, numbers, sections
from automarine_cli.report.tables import MISSING, Table, escape, interval, number
from automarine_cli.report.thruster_tables import cells
from automarine_cli.runs.run import command_warnings
from automarine_cli.thrusters.family import ALPHA
from automarine_cli.thrusters.fit import Parameter

OF = {"moment": "a moment", "gain": "a gain", "drag": "linear drag"}  # kinds of learned curves in words
PLANNED = "`automarine plan MODEL --diagnosis diagnosis.json` plans the runs that separate them."
FALLS = 0.02  # share of the noise by which a gap has to fall for that to be told
LARGE_MOVE = 2.0  # standard errors: a base parameter that moved by more had been absorbing something
MOST_REGIONS, MOST_NAMED_RUNS, MOST_FAULTS = 8, 5, 8
NOWHERE = "The error depends on no variable beyond chance."


def _page(
    title: str, first: Iterable[Table | str], where: Sequence[Region], regions: Table, why: Iterable[Table | str],
    gap: Iterable[Table | str], rest: Iterable[Table | str] = (), drawn: Iterable[str] = ("where", "before_after"),
) -> str:  # fmt: skip
    """Write the page for a person: what comes first, where, why, before and after, and the rest."""
    more = len(where) - MOST_REGIONS
    return document(
        f"# {title}", *first,
        "## Where the gap is", regions if where else NOWHERE,
        f"{more} more regions are in diagnosis.json." if more > 0 else "",
        "![Where the gap is](where.png)" * ("where" in drawn),
        "## Why", *why, "![Why](why.png)",
        "## The gap before and after", *gap, "![Before and after](before_after.png)" * ("before_after" in drawn),
        *rest,
    )  # fmt: skip


def _rivals(effect: NamedEffect) -> list[str]:
    """What else it may be, a sentence each."""
    return [
        *(
            f"Cannot be excluded: {rival.name} (weight {rival.confidence:.0%}). Told apart by {rival.split_by}."
            for rival in effect.few_rivals
        ),
        *filter(None, [effect.other_rivals]),
    ]


@sections.register
def _(result: MotionDiagnosis) -> Sections:
    diagnosis, dof = result.diagnosis, result.stored.dof
    lines = [f"Warning: {warning}" for warning in command_warnings(diagnosis.study.runs)]
    lines.append(verdict_sentence(diagnosis))
    for effect in diagnosis.effects:
        lines += [f"{effect.name}: {effect.says}", *_rivals(effect)]
    if any(effect.rivals for effect in diagnosis.effects):
        lines.append(PLANNED)
    if diagnosis.study.cycle is not None:
        lines.append(diagnosis.study.cycle.sentence(dof))
    lines += fit_sentences(diagnosis.channels, diagnosis.found.final.fit, dof)
    files: dict[str, Content] = {
        "diagnosis.json": result.to_json(), "extended_model.json": result.extended_model(),
        "diagnosis.md": page(diagnosis),
    }  # fmt: skip
    drawings = {
        "where": partial(figures.where_figure, diagnosis.where, diagnosis.words),
        "why": partial(figures.why_figure, diagnosis),
        "before_after": partial(figures.before_after_figure, diagnosis),
    }
    for curve in (effect.learned for effect in diagnosis.effects if effect.learned is not None):
        drawings["learned"] = partial(figures.learned_figure, diagnosis, curve)
    rows = [
        {"effect": effect.name, "confidence": effect.confidence, "parameter": name, **numbers(estimate)}
        for effect in diagnosis.effects
        for name, estimate in effect.parameters.items()
    ]
    return Sections([*lines, *tables(diagnosis)], files, drawings, rows=rows)


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence with its numbers."""
    dof, said, driven = diagnosis.study.base.dof, diagnosis.said, diagnosis.study.driven
    unit, position = dof.units.shown, dof.words.position
    before, after, floor = headline_gap(diagnosis)
    counted = diagnosis.found.final.counted
    names = " and ".join(_or_rivals(effect) for effect in diagnosis.effects if effect.name in counted)
    if drag := [effect.name for effect in diagnosis.effects if effect.name not in counted]:
        names += f", where {' and '.join(drag)} puts the drag of the base right"
    held_out = 0 if diagnosis.held_out is None else len(diagnosis.held_out.runs)
    gap = f"error of predictions {JUDGED:g} s ahead" if driven else "gap"
    gap += f" of the {held_out} run{'s' * (held_out > 1)} held out" if held_out else ""
    beside = _beside(diagnosis, f"noise of the {position} {floor} {unit}")
    if said.word == NAMED:
        falls = gains_instead(diagnosis) or f"the {gap} falls from {before} to {after} {unit} ({beside})"
        return f"Named: {names}; {falls}. {said.left}".strip()
    if said.word == SUSPECTED:
        return f"Suspected, not named: {names}. {said.why}"
    if said.word == UNEXPLAINED:
        return f"Unexplained: the {gap} is {before} {unit} ({beside}). {said.why}"
    disturbed = " beside their disturbances" * driven
    ends = f" ({beside})." if driven else f", {beside}."
    return f"Nothing missing that these runs could show{disturbed}: {gap} {before} {unit}{ends}"


def headline_gap(diagnosis: Diagnosis) -> tuple[str, str, str]:
    """The gap before and after and the noise, as people see them: of the runs held out, where there are some."""
    gap, outlook = diagnosis.gap, diagnosis.outlook
    if diagnosis.held_out_gap is not None:
        gap, outlook = diagnosis.held_out_gap, diagnosis.held_out_outlook
    judged = None if outlook is None else outlook.judged
    sizes = (gap.before, gap.after) if judged is None else (judged[0].error, judged[1].error)
    before, after, floor = (f"{diagnosis.study.base.dof.shown(x):.2f}" for x in (*sizes, gap.floor))
    return before, after, floor


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


def _beside(diagnosis: Diagnosis, noise: str) -> str:
    """What the gap is to be compared with: the noise, and of driven runs what constants miss by."""
    outlook, dof = diagnosis.outlook, diagnosis.study.base.dof
    if diagnosis.held_out_gap is not None:
        outlook = diagnosis.held_out_outlook
    if outlook is None or outlook.judged is None:
        return noise
    rate, still = (f"{dof.shown(x):.2f}" for x in (outlook.judged[0].constant_rate, outlook.judged[0].constant))
    return (
        f"a constant {dof.words.speed} misses by {rate} and a constant {dof.words.position} by {still} "
        f"{dof.units.shown}, {noise}"
    )


def outlook_table(fitted: Outlook | None, held_out: Outlook | None, dof: Dof) -> list[Table]:
    """Errors of predictions by horizon, of runs fitted and held out; none of runs that are not driven."""
    unit, words = dof.units.shown, dof.words
    rows = [
        {
            "runs": f"{name}, {before.horizon:g} s ahead",
            f"before [{unit}]": f"{dof.shown(before.error):.2f}",
            f"after [{unit}]": f"{dof.shown(after.error):.2f}",
            f"constant {words.speed} [{unit}]": f"{dof.shown(before.constant_rate):.2f}",
            f"constant {words.position} [{unit}]": f"{dof.shown(before.constant):.2f}",
        }
        for name, outlook in (("fitted", fitted), ("held out", held_out))
        for before, after in (outlook.ahead if outlook else ())
    ]
    note = (
        "Root mean square errors; the filter knows the readings until each prediction begins, and the commands "
        "after it as they were logged."
    )
    return [Table.of("Predictions from the filtered state", rows, [note])] if rows else []


def estimates(effect: NamedEffect, dof: Dof) -> Iterator[dict[str, Any]]:
    """Rows of an effect's parameters, without those of laws that do not hold; of a choice between laws the word."""
    if effect.learned is not None:
        curve = f"curve of {OF[effect.learned.kind]}"
        yield {"parameter": curve, "estimate": curve_cell(effect.learned), "unit": effect.learned.unit}
        return
    cards = {card.name: card.meaning for card in effects.get(effect.name).card(dof).parameters}
    library, values = effects.get(effect.name), [estimate.value for estimate in effect.parameters.values()]
    for parameter, (name, estimate) in zip(library.parameters, effect.parameters.items()):
        if library.counts(parameter, values):
            word = parameter.choices[round(estimate.value)] if parameter.choices else interval(estimate)
            yield {"parameter": name, "meaning": cards[name], "estimate": word, "unit": estimate.unit}


def curve_cell(curve: LearnedCurve) -> str:
    """A curve in a cell: between which values it goes."""
    scale, unit = (100.0, "%") if curve.kind == "gain" else (1.0, curve.y_unit)
    low, high = scale * curve.y.min(), scale * curve.y.max()
    return f"{low:+.3g} to {high:+.3g} {unit} over {number(curve.x[0], 3)} to {number(curve.x[-1], 3)}"


def tables(diagnosis: Diagnosis) -> tuple[Table, ...]:
    """Effects with their parameters, gap, and the best candidates."""
    dof, rows = diagnosis.study.base.dof, list[dict[str, Any]]()
    for effect in diagnosis.effects:
        for row in estimates(effect, dof):
            row.pop("meaning", None)
            rows.append({"effect": effect.name, **row, "confidence": f"{effect.confidence:.0%}"})
    ahead = outlook_table(diagnosis.outlook, diagnosis.held_out_outlook, dof) or [gap_table(diagnosis)]
    named = [Table.of("Effects", rows)] if rows else []
    return (*named, *ahead, evidence_table(diagnosis))


def evidence_table(diagnosis: Diagnosis) -> Table:
    """Evidence of the best candidates."""
    first = diagnosis.found.rounds[0]
    best = sorted(first.trials, key=lambda trial: trial.evidence)[:5]
    rows = [{"effect": trial.added[-1], "evidence gained": number(first.gain(trial), 3)} for trial in best]
    how = "the innovations of a filter, disturbances with it" if diagnosis.study.driven else "simulating whole runs"
    return Table.of("Candidates", rows, [
        f"Significance threshold: {number(first.threshold, 2)}, which chance reaches in {1000 * LEVEL:.0f} of 1000 "
        f"campaigns. Each candidate was fitted together with the base model by {how}.",
    ])  # fmt: skip


def page(diagnosis: Diagnosis) -> str:
    """Write the whole page in Markdown."""
    study, found = diagnosis.study, diagnosis.found
    dof, where, cycle = study.base.dof, diagnosis.where, diagnosis.study.cycle
    held_out = "" if diagnosis.held_out is None else f" and {len(diagnosis.held_out.runs)} held out"
    first = [
        escape(f"{verdict_sentence(diagnosis)} {len(study.runs)} runs were fitted{held_out}."),
        escape(" ".join(fit_sentences(diagnosis.channels, found.final.fit, dof))),
        *(block for effect in diagnosis.effects for block in (f"## {effect.name}", *_effect(diagnosis, effect))),
    ]
    why: list[Table | str] = [
        evidence_table(diagnosis),
        " ".join([*([cycle.sentence(dof)] if cycle else []), found.crowd or ""]),
    ]
    gap = [gap_table(diagnosis), *outlook_table(diagnosis.outlook, diagnosis.held_out_outlook, dof)]
    rest = ["## What it does to the model", *_moves(diagnosis), "## What remains", _remains(diagnosis)]
    rest += ["## What to run next", _next(diagnosis)]
    if diagnosis.verdict != NAMED:
        rest += ["## What these runs would have shown", detectable_table(diagnosis)]
    regions = regions_table(where.regions, dof.units.shown, dof.words.force)
    return _page(f"Diagnosis of the {dof.name} model", first, where.regions, regions, why, gap, rest)


def _effect(diagnosis: Diagnosis, effect: NamedEffect) -> list[Table | str]:
    """One effect: equation, parameters, how sure, rivals, source."""
    dof = diagnosis.study.base.dof
    smallest = 1.0 / (1 + len(diagnosis.found.rounds[0].scores.null))
    chance = "at most" if effect.p_value <= 1.01 * smallest else "about"
    sure = (
        f"Chance alone would gain as much in {chance} {100 * effect.p_value:.2g} of 100 campaigns like "
        f"this one. Confidence that it is this effect: {effect.confidence:.0%}."
    )
    law = effects.get(effect.name).law_at([estimate.value for estimate in effect.parameters.values()])
    curve = ["![What was learned](learned.png)", "The curve as a table is in diagnosis.json, under `learned`."]
    return [
        effect.says,
        f"`{dof.fill(law.equation)}`",
        Table.of("", list(estimates(effect, dof))),
        sure + " No other effect of the library fits nearly as well." * (not effect.rivals),
        bullets(map(escape, _rivals(effect))),
        *(curve if effect.learned is not None else ()),
        f"Source: {law.source}.",
    ]


def _moves(diagnosis: Diagnosis) -> list[Table | str]:
    """Base parameters before and after."""
    study, symbols = diagnosis.study, diagnosis.study.base.dof.symbols
    names = {symbols.constant: "constant force", symbols.difference: "half the difference of drag"}
    before = base_estimates(study, diagnosis.found.base)
    if diagnosis.verdict != NAMED:
        rows = [
            {"parameter": names.get(name, name), "estimate and 95 % interval": estimate, "unit": estimate.unit}
            for name, estimate in before.items()
        ]
        return ["Nothing was added; the base model fitted to these runs is", Table.of("", rows)]
    after = base_estimates(study, diagnosis.found.final)
    rows, moved = [], list[str]()
    for name, old in before.items():
        new = after[name]
        change = (new.value - old.value) / old.value if abs(old.value) > 1e-6 * abs(new.value) else float("nan")
        rows.append({
            "parameter": names.get(name, name), "base model": old, "with what was missing": new,
            "change": f"{change:+.1%}" if np.isfinite(change) else MISSING, "unit": new.unit,
        })  # fmt: skip
        if abs(new.value - old.value) > LARGE_MOVE * float(np.hypot(old.stderr, new.stderr)):
            moved.append(names.get(name, name))
    said = (
        f"{' and '.join(moved)} moved by more than the uncertainty: the base model had absorbed part of what is "
        "missing."
        if moved
        else "No base parameter moved by more than its uncertainty."
    )
    anew = f"The base model is fitted anew to these {len(study.runs)} runs: it is not quite that of the file."
    return [Table.of("", rows), f"{said} {anew}"]


def _remains(diagnosis: Diagnosis) -> str:
    gap, dof = diagnosis.gap, diagnosis.study.base.dof
    if diagnosis.study.driven:
        return (
            f"Predictions {JUDGED:g} s ahead still miss by {dof.shown(gap.after):.2g} {dof.words.units}: the rest "
            "is disturbances that are not logged, and what the model lacks."
        )
    ratio = gap.after / max(gap.floor, 1e-12)
    return f"The remaining gap is {ratio:.2f} times the noise of the {dof.words.position}. " + (
        "That is the noise level: nothing more can be fitted to these runs."
        if ratio < 1.0 + WELL_ABOVE
        else "A residual remains that no candidate explains; see where.png."
    )


def _next(diagnosis: Diagnosis) -> str:
    dof = diagnosis.study.base.dof
    lines = [PLANNED] if any(effect.few_rivals for effect in diagnosis.effects) else []
    for effect in diagnosis.effects:
        lines.append(f"To see {effect.name} better: {effects.get(effect.name).card(dof).reveals}.")
    return bullets((*lines, *general_advice(diagnosis.study)))


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
    kinds = {force: f"missing {force}", THRUST: "each run's own thrust", SIZE: "size of each run's gap"}
    rows = []
    for region in regions[:MOST_REGIONS]:
        some, more = ", ".join(region.runs[:MOST_NAMED_RUNS]), len(region.runs) - MOST_NAMED_RUNS
        rows.append({
            "variable": region.variable, "from": number(region.low, 3), "to": number(region.high, 3),
            "unit": region.unit or MISSING, f"gap [{unit}]": number(region.gap, 3),
            "share of the gap": f"{region.share:.0%}", "seen in": kinds.get(region.seen_in, region.seen_in),
            "p": number(region.p_value, 2), "runs": f"{some} and {more} more" if more > 0 else some or MISSING,
        })  # fmt: skip
    note = (
        "p is corrected for all bins and variables. Shares of different variables overlap: they are views of one gap."
    )
    return Table.of("", rows, [note])


def gap_table(diagnosis: Diagnosis) -> Table:
    """Root mean square gap before and after, against the noise, on runs fitted and held out."""
    position, unit = diagnosis.study.base.dof.words.position, diagnosis.study.base.dof.units.shown
    gaps: list[tuple[Study | None, Gap | None, str]] = [
        (diagnosis.study, diagnosis.gap, "fitted"), (diagnosis.held_out, diagnosis.held_out_gap, "held out"),
    ]  # fmt: skip
    rows = []
    for study, gap, word in gaps:
        if study is None or gap is None:
            continue
        before, after, floor = (f"{study.base.dof.shown(x):.2f}" for x in (gap.before, gap.after, gap.floor))
        above = gap.before**2 - gap.floor**2
        closed = np.clip((gap.before**2 - gap.after**2) / above, 0.0, 1.0) if above > 0.02 * gap.floor**2 else None
        rows.append({
            "runs": f"{len(study.runs)} runs {word}", f"before [{unit}]": before, f"after [{unit}]": after,
            f"noise of the {position} [{unit}]": floor,
            "gap above the noise closed": MISSING if closed is None else f"{closed:.0%}",
        })  # fmt: skip
    scatter = [100.0 * trial.fit.factor(GAIN) for trial in (diagnosis.found.base, diagnosis.found.final)]
    note = (
        f"Root mean square errors of {position}s predicted {JUDGED:g} s ahead from the filtered state."
        if diagnosis.study.driven
        else f"Root mean square over whole runs simulated from their start, with each run's own start {position}, "
        f"thrust and switch instants. Thrust differs from run to run by {scatter[0]:.1f} % before and "
        f"{scatter[1]:.1f} % after."
    )
    return Table.of("", rows, [note])


def detectable_table(diagnosis: Diagnosis) -> Table:
    """Smallest size of each effect that would have been named four times in five."""
    rows, base = [], diagnosis.study.base
    for name, size in sorted(diagnosis.detectable.items()):
        parameters = effects.get(name).parameters
        sized = next((i for i, p in enumerate(parameters) if not p.scan and not p.held), 0)  # no shape, and fitted
        card = effects.get(name).card(base.dof, base.moment_unit).parameters[sized]
        unit = card.unit or MISSING
        rows.append({"effect": name, "parameter": card.name, "smallest size seen": number(size, 2), "unit": unit})
    note = "Sizes that these runs detect with 80 % power, measured from the value at which the effect is off."
    return Table.of("", rows, [note], header=("effect", "parameter", "smallest size seen", "unit"))


@sections.register
def _(result: PlanarDiagnosis) -> Sections:
    search = result.search
    lines = [planar_verdict(search)]
    for look in search.steps:
        if look.best is not None:
            lines.append(f"{look.best.candidate.name}: {look.best.candidate.says}")
        lines += [f"Cannot be excluded: {rival.candidate.label}: {rival.candidate.split_by}" for rival in look.rivals]
    evidence = _planar_evidence(search)
    ahead = outlook_table(search.outlook(False) or None, search.outlook(True) or None, YAW)
    drawings = {"why": partial(figures.planar_why_figure, search)}
    if search.where is not None:
        horizon = judged(search.foretold[0][YAW.position]).horizon
        less = f"predicted {horizon:g} s ahead"
        drawings = {
            "where": partial(figures.where_figure, search.where, search.words, "stretches of runs", less),
            **drawings,
            "before_after": partial(figures.planar_before_after_figure, search),
        }
    regions = () if search.where is None else search.where.regions
    where = regions_table(regions, YAW.units.shown, YAW.words.force)
    text = _page("Diagnosis of the planar model", map(escape, lines), regions, where, [evidence], ahead, (), drawings)
    files: dict[str, Content] = {
        "diagnosis.json": result.to_json(), "extended_model.json": result.extended_model(), "diagnosis.md": text,
    }  # fmt: skip
    rows = [
        {"effect": contender.candidate.name, "parameter": name, **numbers(estimate)}
        for contender in search.named
        for name, estimate in result.estimates_of(contender).items()
    ]
    return Sections([*lines, evidence, *ahead], files, drawings, rows=rows)


def planar_verdict(search: PlanarSearch) -> str:
    """The verdict in one sentence with its numbers."""
    if search.verdict == NOTHING:
        return "Nothing is missing that the runs could show."
    if search.verdict == UNEXPLAINED:
        return f"Unexplained. {search.why}"
    if search.verdict == SUSPECTED:
        return f"Suspected: {search.words.removeprefix('suspected ')}. {search.why}"
    held_out = search.outlook(True)
    if held_out is None:
        return f"Named: {search.words}."
    before, after = (f"{YAW.shown(score.error):.3g}" for score in held_out.longest)
    return (
        f"Named: {search.words}; on runs held out the heading is predicted {held_out.longest[0].horizon:g} s ahead to "
        f"{after} deg, {before} before."
    )


def _planar_evidence(search: PlanarSearch) -> Table:
    """One row a candidate that was fitted, look by look, the best first."""
    rows = []
    for i, look in enumerate(search.rounds, 1):
        best, rivals = look.best and look.best.candidate.added, [rival.candidate.added for rival in look.rivals]
        for contender in sorted(look.tried, key=lambda contender: -contender.surplus):
            added = contender.candidate.added
            word = "named" if added == best else "rival" if added in rivals else MISSING
            word = "suspected" if contender in search.suspected else word
            word = "some runs only" if word == MISSING and contender is search.passed_over else word
            rows.append({
                "look": str(i), "effect": contender.candidate.label, "deviance gained": contender.surplus,
                "held-out log likelihood gained": contender.held_out, "is": word,
            })  # fmt: skip
    rest = sum(len(look.promised) - len(look.tried) for look in search.rounds)
    note = (
        f"The threshold is a deviance of {HEAD_START:g} beyond the penalty. Not fitted were {rest} whose score, "
        "the slope of the likelihood, promised less than others, or less than the threshold."
    )
    header = ("look", "effect", "deviance gained", "held-out log likelihood gained", "is")
    return Table.of("Evidence", rows, [note], header=header)


@sections.register
def _(result: ThrusterDiagnosis) -> Sections:
    drawings = {
        "where": partial(figures.thruster_where_figure, result),
        "why": partial(figures.thruster_why_figure, result),
        "before_after": partial(figures.thruster_before_after_figure, result),
    }
    lines, faults = thruster_sentences(result), _faults(result)
    effects, gaps, candidates = _thruster_effects(result), _thruster_gaps(result), _thruster_candidates(result)
    regions = regions_table(result.where.regions, "N")
    remains = ["## What remains", _thruster_remains(result), bullets(map(escape, faults))]
    text = _page(
        "Diagnosis of a thruster map", [*map(escape, lines), *effects], result.where.regions, regions, [candidates],
        [gaps], remains,
    )  # fmt: skip
    files: dict[str, Content] = {
        "diagnosis.json": result.to_json(), "extended_model.json": result.extended_map, "diagnosis.md": text,
    }  # fmt: skip
    rows = [
        {"effect": effect.name, "confidence": effect.confidence, "parameter": name, **cells(parameter)}
        for effect in result.effects
        for name, parameter in effect.parameters.items()
    ]
    shown = [gaps, *effects, *([regions] if result.where.regions else []), candidates]
    return Sections([*lines, _thruster_remains(result), *faults, *shown], files, drawings, rows=rows)


def thruster_sentences(result: ThrusterDiagnosis) -> list[str]:
    """The verdict in one sentence with its numbers, what is missing, and what else it could be."""
    lines = [_thruster_verdict(result)]
    for effect in result.effects:
        sure = "above 99 %" if effect.confidence > 0.99 else f"{100 * effect.confidence:.0f} %"
        lines.append(f"{effect.name}: {effect.says} Confidence {sure} (p = {effect.p_value:.2g}).")
        lines += _rivals(effect)
    return lines


def _thruster_verdict(result: ThrusterDiagnosis) -> str:
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


def _thruster_remains(result: ThrusterDiagnosis) -> str:
    gap = result.gap
    above = gap.after > thruster_map.WELL_ABOVE * gap.floor and result.verdict in (NAMED, NOTHING)
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


def _thruster_gaps(result: ThrusterDiagnosis) -> Table:
    """Before and after on levels fitted, held out, and by cross-validation."""
    rows = []
    for name, gap in (
        ("fitted levels", result.gap), ("held-out levels", result.held_out_gap), ("cross-validation", result.cross),
    ):  # fmt: skip
        before, after, floor = (None, None, None) if gap is None else (gap.before, gap.after, gap.floor)
        rows.append({
            "levels": name, "before [N]": number(before, 3), "after [N]": number(after, 3),
            "before [% of full scale]": MISSING if before is None else number(result.percent(before), 3),
            "after [%]": MISSING if after is None else number(result.percent(after), 3),
            "noise level [N]": number(floor, 2),
        })  # fmt: skip
    notes = [
        "Before: the map's form refitted. After: with the effects that are named.",
        f"The map exactly as given is {number(result.given_rmse, 3)} N off on the fitted levels.",
    ]
    if result.held_out is None:
        notes.append("Too few levels to hold any out: cross-validation leaves each out in turn.")
    return Table.of("Gap between map and measurement (root mean square)", rows, notes)


def _thruster_effects(result: ThrusterDiagnosis) -> list[Table]:
    rows = [
        {"effect": effect.name, "parameter": name, "estimate": _value(value), "confidence": f"{effect.confidence:.0%}"}
        for effect in result.effects
        for name, value in effect.parameters.items()
    ]
    return [Table.of("Effects", rows)] if rows else []


def _thruster_candidates(result: ThrusterDiagnosis) -> Table:
    """Every effect that was tried in the first step, and what it alone would win."""
    first = result.search.steps[0]
    rows = [
        {
            "effect": candidate.effect, "direction": candidate.where, "evidence gained": number(candidate.gain, 3),
            "p": f"{candidate.p_value:.3f}",
            "cross-validated error [% of full scale]": number(result.percent(candidate.fit.rmse(held_out=True)), 3),
        }
        for candidate in sorted(first.candidates, key=lambda candidate: candidate.fit.rmse(held_out=True))
    ]  # fmt: skip
    note = (
        f"Significance threshold: {number(first.threshold, 3)}, which chance reaches in {1000 * ALPHA:.0f} of 1000 "
        "maps without any effect; p is corrected for the number of candidates."
    )
    return Table.of("Candidates", rows, [note])


def _value(value: Parameter) -> str:
    if value.value is None:
        return "beyond what was measured"
    if value.estimate is None:
        return number(value.value)
    low, high = value.estimate.ci95
    return f"{number(value.value)} [{number(low)}, {number(high)}] {value.unit}".rstrip()
