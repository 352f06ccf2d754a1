"""What `diagnose` shows of a model of one motion, of the plane or of a thruster map: the verdict in a sentence, tables,
the page for a person, figures."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
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
    MotionDiagnosis,
    NamedEffect,
    Outlook,
    base_estimates,
)
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
from automarine_cli.report.sections import Sections, bullets, document, numbers, sections
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
    lines = [
        f"Cannot be excluded: {rival.name} (weight {rival.confidence:.0%}). Told apart by {rival.split_by}."
        for rival in effect.few_rivals
    ]
    return [*lines, *filter(None, [effect.other_rivals])]


def _sections(
    result: Any, extended: Mapping[str, object], page: str, printed: Sequence[Table | str],
    drawings: Mapping[str, partial[Any]], rows: Sequence[Mapping[str, object]],
) -> Sections:  # fmt: skip
    files = {"diagnosis.json": result.to_json(), "extended_model.json": extended, "diagnosis.md": page}
    return Sections(printed, files, drawings, rows=rows)


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
    drawings = {
        "where": partial(figures.where_figure, diagnosis.where, diagnosis.words),
        "why": partial(figures.why_figure, diagnosis),
        "before_after": partial(figures.before_after_figure, diagnosis),
    }
    for effect in diagnosis.effects:
        if effect.learned is not None:
            drawings["learned"] = partial(figures.learned_figure, diagnosis, effect.learned)
    rows = [
        {"effect": effect.name, "confidence": effect.confidence, "parameter": name, **numbers(estimate)}
        for effect in diagnosis.effects
        for name, estimate in effect.parameters.items()
    ]
    printed: list[Table | str] = [*lines, *tables(diagnosis)]
    return _sections(result, result.extended_model(), page(diagnosis), printed, drawings, rows)


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """Say the verdict in one sentence with its numbers: those of the runs held out, where there are some."""
    dof, said, driven = diagnosis.study.base.dof, diagnosis.said, diagnosis.study.driven
    unit, words, gap, outlook = dof.units.shown, dof.words, diagnosis.gap, diagnosis.outlook
    named = f"error of predictions {JUDGED:g} s ahead" if driven else "gap"
    if diagnosis.held_out is not None and diagnosis.held_out_gap is not None:
        gap, outlook, held_out = diagnosis.held_out_gap, diagnosis.held_out_outlook, len(diagnosis.held_out.runs)
        named += f" of the {held_out} run{'s' * (held_out > 1)} held out"
    before, after, floor = (f"{dof.shown(x):.2f}" for x in (gap.before, gap.after, gap.floor))
    beside = f"noise of the {words.position} {floor} {unit}"
    if outlook is not None and (judged := outlook.judged) is not None:
        before, after, rate, still = (
            f"{dof.shown(x):.2f}"
            for x in (judged[0].error, judged[1].error, judged[0].constant_rate, judged[0].constant)
        )
        misses = f"a constant {words.speed} misses by {rate} and a constant {words.position} by {still} {unit}"
        beside = f"{misses}, {beside}"
    counted = diagnosis.found.final.counted
    names = " and ".join(_or_rivals(effect) for effect in diagnosis.effects if effect.name in counted)
    if drag := [effect.name for effect in diagnosis.effects if effect.name not in counted]:
        names += f", where {' and '.join(drag)} puts the drag of the base right"
    falls = _gains_instead(diagnosis) or f"the {named} falls from {before} to {after} {unit} ({beside})"
    disturbed, ends = (" beside their disturbances", f" ({beside}).") if driven else ("", f", {beside}.")
    nothing = f"Nothing missing that these runs could show{disturbed}: {named} {before} {unit}{ends}"
    unexplained = f": the {named} is {before} {unit} ({beside})"
    return _verdict(said.word, names, said.why, nothing, f"; {falls}. {said.left}".rstrip(), unexplained)


def _verdict(word: str, names: str, why: str, nothing: str, named: str, unexplained: str = "") -> str:
    """The verdict in one sentence, of motions, the plane and maps alike: `nothing` is that where nothing is missing,
    `named` and `unexplained` are the numbers that follow these words."""
    sentences = {
        NAMED: f"Named: {names}{named}", SUSPECTED: f"Suspected, not named: {names}. {why}",
        UNEXPLAINED: f"Unexplained{unexplained}. {why}", NOTHING: nothing,
    }  # fmt: skip
    return sentences[word]


def _or_rivals(effect: NamedEffect) -> str:
    """An effect's name; of one that is less likely than its rivals together those too."""
    rivals = effect.few_rivals if effect.confidence < EVEN else ()
    return " or ".join([effect.name, *(rival.name for rival in rivals)])


def _gains_instead(diagnosis: Diagnosis) -> str:
    """What was gained where no gap could fall because each run's own gain had followed what was missing: the scatter of
    the thrust; empty elsewhere."""
    gap, found, dof = diagnosis.gap, diagnosis.found, diagnosis.study.base.dof
    before, after = (100.0 * trial.fit.factor(GAIN) for trial in (found.base, found.final))
    if diagnosis.study.driven or gap.before - gap.after > FALLS * gap.floor or after > 0.7 * before:
        return ""
    return (
        f"thrust differs from run to run by {after:.1f} % instead of {before:.1f} % (the gap stays at "
        f"{dof.shown(gap.after):.2f} {dof.units.shown}, which is noise)"
    )


def _outlook_tables(fitted: Outlook | None, held_out: Outlook | None, dof: Dof) -> list[Table]:
    """Errors of predictions by horizon, of runs fitted and held out; no table of runs that are not driven."""
    unit, words = dof.units.shown, dof.words
    names = ("before", "after", f"constant {words.speed}", f"constant {words.position}")
    rows = [
        {"runs": f"{name}, {before.horizon:g} s ahead"}
        | {
            f"{column} [{unit}]": f"{dof.shown(error):.2f}"
            for column, error in zip(names, (before.error, after.error, before.constant_rate, before.constant))
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
    if (curve := effect.learned) is not None:
        scale, unit = (100.0, "%") if curve.kind == "gain" else (1.0, curve.y_unit)
        low, high = scale * curve.y.min(), scale * curve.y.max()
        cell = f"{low:+.3g} to {high:+.3g} {unit} over {number(curve.x[0], 3)} to {number(curve.x[-1], 3)}"
        yield {"parameter": f"curve of {OF[curve.kind]}", "estimate": cell, "unit": curve.unit}
        return
    library, values = effects.get(effect.name), [estimate.value for estimate in effect.parameters.values()]
    cards = library.card(dof).parameters
    for parameter, card, (name, estimate) in zip(library.parameters, cards, effect.parameters.items()):
        if library.counts(parameter, values):
            word = parameter.choices[round(estimate.value)] if parameter.choices else interval(estimate)
            yield {"parameter": name, "meaning": card.meaning, "estimate": word, "unit": estimate.unit}


def tables(diagnosis: Diagnosis) -> tuple[Table, ...]:
    """Lay out effects with their parameters, the gap, and the best candidates."""
    dof = diagnosis.study.base.dof
    rows = [
        {"effect": effect.name, **row, "confidence": f"{effect.confidence:.0%}"}
        for effect in diagnosis.effects
        for row in estimates(effect, dof)
    ]
    for row in rows:
        row.pop("meaning", None)
    ahead = _outlook_tables(diagnosis.outlook, diagnosis.held_out_outlook, dof) or [gap_table(diagnosis)]
    named = [Table.of("Effects", rows)] if rows else []
    return (*named, *ahead, evidence_table(diagnosis))


def evidence_table(diagnosis: Diagnosis) -> Table:
    first = diagnosis.found.rounds[0]
    best = sorted(first.trials, key=lambda trial: trial.evidence)[:5]
    rows = [{"effect": trial.added[-1], "evidence gained": number(first.gain(trial), 3)} for trial in best]
    how = "the innovations of a filter, disturbances with it" if diagnosis.study.driven else "simulating whole runs"
    return Table.of("Candidates", rows, [
        f"Significance threshold: {number(first.threshold, 2)}, which chance reaches in {1000 * LEVEL:.0f} of 1000 "
        f"campaigns. Each candidate was fitted together with the base model by {how}.",
    ])  # fmt: skip


def page(diagnosis: Diagnosis) -> str:
    """Write the page in Markdown."""
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
    gap = [gap_table(diagnosis), *_outlook_tables(diagnosis.outlook, diagnosis.held_out_outlook, dof)]
    rest = ["## What it does to the model", *_moves(diagnosis), "## What remains", _remains(diagnosis)]
    rest += ["## What to run next", _next(diagnosis)]
    if diagnosis.verdict != NAMED:
        rest += ["## What these runs would have shown", detectable_table(diagnosis)]
    regions = regions_table(where.regions, dof.units.shown, dof.words.force)
    return _page(f"Diagnosis of the {dof.name} model", first, where.regions, regions, why, gap, rest)


def _effect(diagnosis: Diagnosis, effect: NamedEffect) -> list[Table | str]:
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
    said = "No base parameter moved by more than its uncertainty."
    if moved:
        absorbed = "the base model had absorbed part of what is missing"
        said = f"{' and '.join(moved)} moved by more than the uncertainty: {absorbed}."
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
    words = study.base.dof.words
    advice = (
        (coasts < 2, "Add two coast-downs: they separate a dead-band from Coulomb drag and show thrust loss."),
        (reversals < 2, f"Add two reversals at full {words.force}: lags, delay and swirl show most there."),
        (even > 0.7 and study.base.dof.wraps, f"Start runs from other {words.position}s: a {words.sensor} and a "
         f"current show only against {words.position}."),
        (len(sides - {0.0}) < 2,
         f"{words.move.capitalize()} {words.both_ways}: asymmetry and bias need the other sign."),
        (rests == 0,
         f"Add one rest record of a minute: bias, current and {words.rate_sensor} drift show without any model."),
        (not set(study.signals) - set(PARTS),
         "Log the supply voltage: without it a sag can hardly be separated from drag."),
    )  # fmt: skip
    enough = "The campaign has every kind of run; more runs of the same kinds narrow the intervals."
    return tuple(sentence for lacks, sentence in advice if lacks) or (enough,)


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
    rows = []
    for study, gap, word in figures.sets_of(diagnosis):
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
    """Lay out the smallest size of each effect that would have been named four times in five."""
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
    search, where = result.search, result.search.where
    lines = [planar_verdict(search)]
    for look in search.steps:
        if look.best is not None:
            lines.append(f"{look.best.candidate.name}: {look.best.candidate.says}")
        lines += [f"Cannot be excluded: {rival.candidate.label}: {rival.candidate.split_by}" for rival in look.rivals]
    evidence = _planar_evidence(search)
    ahead = _outlook_tables(search.outlook(False), search.outlook(True), YAW)
    drawings = {"why": partial(figures.planar_why_figure, search)}
    if where is not None:
        less = f"predicted {judged(search.foretold[0][YAW.position]).horizon:g} s ahead"
        drawings = {
            "where": partial(figures.where_figure, where, search.words, "stretches of runs", less),
            **drawings,
            "before_after": partial(figures.planar_before_after_figure, search),
        }
    regions = () if where is None else where.regions
    table = regions_table(regions, YAW.units.shown, YAW.words.force)
    text = _page("Diagnosis of the planar model", map(escape, lines), regions, table, [evidence], ahead, (), drawings)
    rows = [
        {"effect": contender.candidate.name, "parameter": name, **numbers(estimate)}
        for contender in search.named
        for name, estimate in result.estimates_of(contender).items()
    ]
    return _sections(result, result.extended_model(), text, [*lines, evidence, *ahead], drawings, rows)


def planar_verdict(search: PlanarSearch) -> str:
    """Say the verdict in one sentence with its numbers: those of the runs held out, where there are some."""
    named, held_out = ".", search.outlook(True)
    if held_out is not None:
        before, after = (f"{YAW.shown(score.error):.3g}" for score in held_out.longest)
        ahead = f"{held_out.longest[0].horizon:g} s ahead to {after} deg, {before} before"
        named = f"; on runs held out the heading is predicted {ahead}."
    names, nothing = search.words.removeprefix("suspected "), "Nothing is missing that the runs could show."
    return _verdict(search.verdict, names, search.why, nothing, named)


def _planar_evidence(search: PlanarSearch) -> Table:
    rows = []
    for i, look in enumerate(search.rounds, 1):
        best, rivals = look.best and look.best.candidate.added, [rival.candidate.added for rival in look.rivals]
        for contender in sorted(look.tried, key=lambda contender: -contender.surplus):
            added, word = contender.candidate.added, MISSING
            if contender in search.suspected:
                word = "suspected"
            elif added == best or added in rivals:
                word = "named" if added == best else "rival"
            elif contender is search.passed_over:
                word = "some runs only"
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
    where, why, before_after = (
        partial(draw, result)
        for draw in (figures.thruster_where_figure, figures.thruster_why_figure, figures.thruster_before_after_figure)
    )
    lines, remains, faults = thruster_sentences(result), _thruster_remains(result), _faults(result)
    gaps, candidates = _thruster_gaps(result), _thruster_candidates(result)
    estimated = [(effect, name, value) for effect in result.effects for name, value in effect.parameters.items()]
    effects = [
        {"effect": effect.name, "parameter": name, "estimate": _value(value), "confidence": f"{effect.confidence:.0%}"}
        for effect, name, value in estimated
    ]
    named = [Table.of("Effects", effects)] if effects else []
    regions = regions_table(result.where.regions, "N")
    text = _page(
        "Diagnosis of a thruster map", [*map(escape, lines), *named], result.where.regions, regions, [candidates],
        [gaps], ["## What remains", remains, bullets(map(escape, faults))],
    )  # fmt: skip
    rows = [
        {"effect": effect.name, "confidence": effect.confidence, "parameter": name, **cells(value)}
        for effect, name, value in estimated
    ]
    marked = [regions] if result.where.regions else []
    printed: list[Table | str] = [*lines, remains, *faults, gaps, *named, *marked, candidates]
    drawings = {"where": where, "why": why, "before_after": before_after}
    return _sections(result, result.extended_map, text, printed, drawings, rows)


def thruster_sentences(result: ThrusterDiagnosis) -> list[str]:
    """Say the verdict in one sentence with its numbers, what is missing, and what else it could be."""
    before, after = (number(result.percent(size), 3) for size in (result.cross.before, result.cross.after))
    scale = f"of full scale ({number(result.data.full_scale)} N)"
    residual, floor = number(result.gap.before, 3), number(result.gap.floor, 3)
    lines = [_verdict(
        result.verdict, " and ".join(effect.name for effect in result.effects), result.why,
        f"Nothing is missing from the {result.given.form} map that these levels could show.",
        f". The cross-validated error falls from {before} % to {after} % {scale}.",
        f": the residual is {residual} N, the noise level {floor} N",
    )]  # fmt: skip
    for effect in result.effects:
        sure = "above 99 %" if effect.confidence > 0.99 else f"{100 * effect.confidence:.0f} %"
        lines.append(f"{effect.name}: {effect.says} Confidence {sure} (p = {effect.p_value:.2g}).")
        lines += _rivals(effect)
    return lines


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
    gaps = {"fitted levels": result.gap, "held-out levels": result.held_out_gap, "cross-validation": result.cross}
    rows = []
    for name, gap in gaps.items():
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


def _thruster_candidates(result: ThrusterDiagnosis) -> Table:
    first = result.search.steps[0]
    errors = [(candidate.fit.rmse(held_out=True), candidate) for candidate in first.candidates]
    rows = [
        {
            "effect": candidate.effect, "direction": candidate.where, "evidence gained": number(candidate.gain, 3),
            "p": f"{candidate.p_value:.3f}",
            "cross-validated error [% of full scale]": number(result.percent(error), 3),
        }
        for error, candidate in sorted(errors, key=lambda pair: pair[0])
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
