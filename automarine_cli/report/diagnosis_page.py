"""`diagnosis.md`: the diagnosis as a page for a person."""

import re

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.estimates import base_estimates
from automarine_cli.diagnosis.study import JUDGED, Study
from automarine_cli.diagnosis.trials import LEVEL
from automarine_cli.diagnosis.verdict import NAMED, SUSPECTED, UNEXPLAINED, WELL_ABOVE, NamedEffect
from automarine_cli.diagnosis.where import Where
from automarine_cli.dofs import Dof
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.fits.channel_noise import fit_sentences
from automarine_cli.report.diagnosis_page_tables import MOST_REGIONS, detectable_table, gap_table, regions_table
from automarine_cli.report.diagnosis_tables import (
    PLANNED,
    counting,
    gains_instead,
    headline_gap,
    of_held_out,
    outlook_table,
    parameter_cell,
    verdict_sentence,
)
from automarine_cli.report.tables import MISSING, Table, code_again, interval, number

LARGE_MOVE = 2.0
"""A base parameter that moved by more than this many of its standard errors had been absorbing something."""


def page(diagnosis: Diagnosis) -> str:
    """Write the whole page in Markdown."""
    dof = diagnosis.study.base.dof
    sensors, ahead = (fit_sentences(diagnosis.channels, diagnosis.found.final.fit, dof), outlook_table(diagnosis))
    parts = [f"# Diagnosis of the {dof.name} model", _summary(diagnosis), escape(" ".join(sensors))]
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


def _summary(diagnosis: Diagnosis) -> str:
    """The verdict in a few sentences."""
    dof = diagnosis.study.base.dof
    position, units = dof.words.position, dof.words.units
    runs = f"{len(diagnosis.study.runs)} runs were fitted"
    if diagnosis.held_out is not None:
        runs += f" and {len(diagnosis.held_out.runs)} held out"
    before, after, floor = headline_gap(diagnosis)
    said = diagnosis.said
    if said.word == NAMED:
        names = " and ".join(f"**{effect.name}**" for effect in diagnosis.effects)
        says = " ".join(effect.says for effect in diagnosis.effects)
        gap = f"gap between simulated and measured {position}"
        if diagnosis.study.driven:
            gap = f"error of the {position} predicted {JUDGED:g} s ahead from the filtered state"
        gap += of_held_out(diagnosis)
        falls = gains_instead(diagnosis) or (
            f"the {gap} falls from {before} to {after} {units}; the noise of the {position} itself is {floor} {units}"
        )
        return " ".join(
            filter(None, (f"The model lacks {names}. {says} With that added {falls}.", said.left, f"{runs}."))
        )
    if said.word == SUSPECTED:
        names = " and ".join(f"**{effect.name}**" for effect in diagnosis.effects)
        return f"Suspected is {names}, and not added to the model. {said.why} {runs}."
    if said.word == UNEXPLAINED:
        return (
            f"Something is missing, and no effect of the library explains it: the gap{of_held_out(diagnosis)} is "
            f"{before} {units} where the noise of the {position} is {floor} {units}. {escape(said.why)} "
            f"Nothing is named. {runs}."
        )
    if diagnosis.study.driven:
        return f"{verdict_sentence(diagnosis)} {runs}."
    return (
        f"Nothing is missing that these runs could show: the gap{of_held_out(diagnosis)} is {before} {units}, the "
        f"noise of the {position} {floor} {units}. {runs}."
    )


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
