"""What the terminal shows of a yaw diagnosis: the verdict in a sentence, and its tables."""

from collections.abc import Iterator, Mapping

from automarine_cli import effects as library
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.diagnosis.study import JUDGED
from automarine_cli.diagnosis.trials import LEVEL
from automarine_cli.diagnosis.verdict import EVEN, NAMED, SUSPECTED, UNEXPLAINED, NamedEffect
from automarine_cli.fits.run_effects import GAIN
from automarine_cli.report.diagnosis_page_tables import gap_table
from automarine_cli.report.tables import Table, interval, number
from automarine_cli.results.estimate import Estimate

OF = {"moment": "a moment", "gain": "a gain", "drag": "linear drag"}
"""Kinds of learned curves in words."""
PLANNED = "`automarine plan MODEL --diagnosis diagnosis.json` plans the runs that separate them."
"""Where advice on rivals leads."""
FALLS = 0.02
"""Share of the noise by which a gap has to fall for that to be told."""


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
    parameter = library.get(effect).parameters[i]
    return parameter.choices[round(estimate.value)] if parameter.choices else interval(estimate)


def counting(effect: str, parameters: Mapping[str, Estimate]) -> Iterator[tuple[int, str, Estimate]]:
    """Place, name and estimate of an effect's parameters, without those of laws that do not hold."""
    one, values = library.get(effect), [estimate.value for estimate in parameters.values()]
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
    effects = Table("Effects", ("effect", "parameter", "estimate", "unit", "confidence"), tuple(rows))
    ahead = outlook_table(diagnosis)
    gaps = gap_table(diagnosis) if ahead is None else ahead
    return (*((effects,) if rows else ()), gaps, evidence)
