"""A model card: what the model is, how well its numbers are known, where it holds and what it was made from.

After Mitchell et al. (2019), Model cards for model reporting, doi 10.1145/3287560.3287596, for a model of motion.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from automarine_cli import __version__, effects
from automarine_cli.effects.learned import PREFIX
from automarine_cli.estimate import Given
from automarine_cli.exports.base import MotionSubject, Target, Written, frame_in_words, mirrored
from automarine_cli.exports.export import in_enu, in_newton_metres
from automarine_cli.exports.vehicle import Vehicle
from automarine_cli.models.model import Term
from automarine_cli.models.store import AddedEffect, ModelEntry, ModelFile
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.text import printable

HEADER = ("parameter", "meaning", "value", "standard error", "95 % interval", "unit")
NO_RANGE = "The file does not tell which {forces} were fitted; fit again with this version of automarine."
NO_LOGS = "Not known: there is no manifest.json beside the model file that is of this file."


def write(vehicle: Vehicle) -> Written:
    subject = vehicle.axis
    file = subject.file
    assert file is not None, "the card is written of a file"
    entry = file.models[subject.origin.number] or ModelEntry()
    parts = [
        f"# Model of {subject.dof.name}: {_code(subject.origin.file)}\n",
        f"Model {subject.origin.number} of the file, written by automarine {__version__}. SHA-256 of the file: "
        f"{subject.origin.sha256}.\n",
        f"- Unit of {subject.dof.words.force}: {subject.model.moment_unit}\n"
        f"- Frame: {frame_in_words(subject.frame, subject.dof)}\n- {_signs(subject)}\n",
        "## Parameters\n",
        Table("", HEADER, tuple(_rows(subject, entry, file.effects))).to_markdown(),
        "## Valid range\n",
        _range(subject, file),
        "## Effects\n",
        _effects(subject),
        "## Data\n",
        _logs(subject, file),
    ]
    if file.warnings:
        parts += ["## Warnings\n", "".join(f"- {printable(warning)}\n" for warning in file.warnings)]
    return Written("\n".join(parts))


def _signs(subject: MotionSubject) -> str:
    symbols, words, r = subject.dof.symbols, subject.dof.words, subject.dof.symbols.velocity
    return (
        f"Signs: {symbols.inertia} {r}' = {subject.force} + the {words.force}s of the effects; drag "
        f"coefficients are positive and act against the {words.speed} {r}. {symbols.inertia} is the sum of "
        f"rigid and added {words.inertia}."
    )


def _rows(subject: MotionSubject, entry: ModelEntry, added: Sequence[AddedEffect]) -> Iterator[tuple[str, ...]]:
    """One row a parameter; uncertainties turn with the frame and the unit as the values do."""
    factor, dof = subject.settings.newton_metres_per_nu or 1.0, subject.dof
    inertia = [x * factor for x in _told(entry.inertia)]
    unit = dof.unit_of("inertia", subject.model.moment_unit)
    yield _row(dof.symbols.inertia, "rigid and added together", inertia, unit)
    parameters = {effect.name: effect.parameters for effect in added}
    for term in subject.model.terms:
        effect = effects.get(term.name)
        names, base = effect.names_in(dof), getattr(entry, effect.role) if effect.role else None
        estimates = {names[0]: base} if base else parameters.get(term.name, {})
        columns = [_told(estimates.get(name), value) for name, value in zip(names, term.values)]
        turned = [_turned(subject, term, [column[i] for column in columns]) for i in range(4)]
        card = effect.card(dof, subject.model.moment_unit)
        for i, (p, told_of) in enumerate(zip(effect.parameters, card.parameters)):
            if not effect.counts(p, term.values):
                continue
            value = term.values[i]
            spread, ends = abs(turned[1][i]), sorted((turned[2][i], turned[3][i]))
            law = f": {p.choices[int(value)]}" if p.choices else ""
            yield _row(f"{term.name} {told_of.name}", told_of.meaning + law, [value, spread, *ends], told_of.unit)


def _turned(subject: MotionSubject, term: Term, column: list[float]) -> tuple[float, ...]:
    model = replace(subject.model, terms=(replace(term, values=tuple(column)),))
    if subject.settings.newton_metres_per_nu is not None:
        model = in_newton_metres(model, subject.settings.newton_metres_per_nu)
    return (in_enu(model) if subject.frame == "ENU" else model).terms[0].values


def _told(estimate: Given | None, value: float = 0.0) -> list[float]:
    """Value, standard error and both ends of an estimate; NaN for what the file does not tell."""
    estimate = estimate or Given(value)
    figures = (estimate.value, estimate.stderr, *(estimate.ci95 or (None, None)))
    return [float("nan") if x is None else x for x in figures]


def _row(name: str, meaning: str, figures: list[float], unit: str) -> tuple[str, ...]:
    value, spread, low, high = figures
    ends = MISSING if low != low or high != high else f"{number(low)} to {number(high)}"
    return (name, meaning, number(value, 5), number(spread, 2), ends, unit)


def _range(subject: MotionSubject, file: ModelFile) -> str:
    dof, words = subject.dof, subject.dof.words
    if file.force_range is None:
        return f"{dof.fill(NO_RANGE)}\n"
    factor = subject.settings.newton_metres_per_nu or 1.0
    sign = -1.0 if subject.frame == "ENU" and mirrored(dof) else 1.0
    low, high = sorted(sign * factor * x for x in file.force_range)
    lines = f"- {words.force}: {number(low)} to {number(high)} {subject.model.moment_unit}\n"
    if file.velocity_range is not None:
        low, high = sorted(sign * x for x in file.velocity_range)
        reached = f"{number(low)} to {number(high)} {subject.rate_unit}"
        lines += f"- {words.speed}: {reached}, steady under each {words.force}\n"
    return f"{lines}\nBeyond it the model was never compared with a vehicle.\n"


def _effects(subject: MotionSubject) -> str:
    descriptions = {name: effects.get(name).card(subject.dof).says for name in subject.values}
    lines = [f"- {name}: {_code(subject.equation_of(name))}. {says}" for name, says in descriptions.items()]
    lines += [f"- left out: {effect.name}: {effect.why}" for effect in subject.left_out]
    return "\n".join(lines) + "\n"


def _logs(subject: MotionSubject, file: ModelFile) -> str:
    grew = f"Grew from {_code(file.parent_file)}, SHA-256 {_code(file.parent_sha256)}.\n\n" if file.parent_file else ""
    if subject.logs is None:
        return f"{grew}{NO_LOGS}\n"
    return grew + Table("", ("log", "SHA-256"), subject.logs).to_markdown()


def _code(text: str) -> str:
    """A name from a file as code, which has no meaning to Markdown."""
    return f"`{printable(text).replace('`', chr(39))}`"


TARGET = Target(
    name="card",
    says="a model card: parameters, intervals, signs, range, data",
    forms={"markdown": ".md"}, carries=frozenset({*effects.built_in(), PREFIX}), varying=True, si=False,
    uses=frozenset({"newton_metres_per_nu"}), write=write,
)  # fmt: skip
