"""What the terminal shows of a yaw diagnosis: the verdict in a sentence, and its tables."""

from automarine_cli import effects as library
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.trials import LEVEL
from automarine_cli.fits.estimate import Estimate
from automarine_cli.report.diagnosis_page_tables import gap_table
from automarine_cli.report.tables import Table, interval, number


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence with its numbers."""
    dof = diagnosis.study.base.dof
    unit, position = dof.units.shown, dof.words.position
    before, after, floor = (
        f"{dof.shown(x):.2f}" for x in (diagnosis.gap.before, diagnosis.gap.after, diagnosis.gap.floor)
    )
    if diagnosis.verdict == "named":
        names = " and ".join(effect.name for effect in diagnosis.effects)
        noise = f"noise of the {position} {floor} {unit}"
        return f"Named: {names}; the gap falls from {before} to {after} {unit} ({noise})."
    if diagnosis.verdict == "unexplained":
        return f"Unexplained: the gap is {after} {unit} where the noise of the {position} is {floor} {unit}."
    return f"Nothing missing that these runs could show: gap {before} {unit}, noise of the {position} {floor} {unit}."


def parameter_cell(effect: str, i: int, estimate: Estimate) -> str:
    """The estimate of an effect's parameter `i` with its interval; the word for a choice between laws."""
    parameter = library.get(effect).parameters[i]
    return parameter.choices[round(estimate.value)] if parameter.choices else interval(estimate)


def tables(diagnosis: Diagnosis) -> tuple[Table, ...]:
    """Effects with their parameters, gap, and the best candidates."""
    rows = [
        (
            effect.name,
            name,
            parameter_cell(effect.name, i, estimate),
            estimate.unit,
            f"{effect.confidence:.0%}",
        )
        for effect in diagnosis.effects
        for i, (name, estimate) in enumerate(effect.parameters.items())
    ]
    found = diagnosis.found.rounds[0]
    best = sorted(found.trials, key=lambda trial: trial.evidence)[:5]
    evidence = Table(
        "Candidates", ("effect", "evidence gained"),
        tuple((trial.added[-1], number(found.gain(trial), 3)) for trial in best),
        notes=(f"Chance reaches {number(found.threshold, 2)} in {1000 * LEVEL:.0f} of 1000 campaigns.",),
    )  # fmt: skip
    effects = Table("Effects", ("effect", "parameter", "estimate", "unit", "confidence"), tuple(rows))
    return (*((effects,) if rows else ()), gap_table(diagnosis), evidence)
