"""A campaign in a few sentences: what must not be used, what was identified, how well it predicts, what it lacked."""

from collections.abc import Iterator, Mapping, Sequence

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.pipeline.words import listed
from automarine_cli.report.campaign_steps import StepResult, Steps, folder_of
from automarine_cli.report.diagnosis_report import escape
from automarine_cli.report.tables import interval, number
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.judged import DiagnosisFile, GapSize, Score, StepDone, ValidationFile
from automarine_cli.results.models import ModelFile, PlanarFile, ThrusterFile

MASSES = ("surge.m_u", "sway.m_v", "yaw.I_r")


def summary(steps: Steps) -> Iterator[str]:
    """A paragraph a motion: what is not to be used first, and the numbers of the final model; nothing where there is
    only a look at the logs."""
    for dof in DOFS.values():
        yield from _of_motion(steps, dof)
    yield from _together(steps)


def _of_motion(steps: Steps, dof: Dof) -> Iterator[str]:
    """The paragraph of one motion; that of yaw tells of the thrusters too."""
    model = steps.get(dof.name, ModelFile)
    judged = steps.get(folder_of(dof, "validation"), ValidationFile)
    lacks = steps.get(folder_of(dof, "diagnosis"), DiagnosisFile)
    tested = steps.get("thrusters", ThrusterFile) if dof is YAW else None
    parts = [_unusable(one) for one in (model, judged) if one is not None]
    within = "" if dof is YAW else f"In {dof.name}, "
    found = [_model(model, lacks) if model else "", _thrust(tested) if tested else ""]
    said = within + "; ".join(one for one in found if one)
    parts.append(f"{said[:1].upper()}{said[1:]}." if any(found) else "")
    if model is not None and model.file.buoyancy is not None:
        parts.append(escape(model.file.buoyancy.says))
    parts += [_predicts(judged, model, added_by(lacks)), _lacks(lacks)]
    if any(parts):
        yield " ".join(filter(None, parts))


def _unusable(step: StepResult[ModelFile] | StepResult[PlanarFile] | StepResult[ValidationFile]) -> str:
    """That a model is of no use, in bold."""
    use = step.file.use if isinstance(step.file, ValidationFile) else step.file.prediction
    return f"**{escape(use.refusal)}**" if use.refusal else ""


def _together(steps: Steps) -> Iterator[str]:
    """The same of surge, sway and yaw together."""
    parts = []
    lacks = steps.get("planar_diagnosis", DiagnosisFile)
    if (model := steps.get("planar", PlanarFile)) is not None:
        fitted = {name: one.estimate for name, one in model.file.parameters.items() if name in MASSES}
        before = {name: one for name, one in fitted.items() if one is not None}
        found = [_bold(name, _after(lacks, name) or one) for name, one in before.items()]
        parts += [_unusable(model)]
        parts.append(f"Surge, sway and yaw together: {escape(model.file.structure)}, with {listed(found)}.")
        parts += [escape(line) for line in model.file.prediction.says[:1] if model.file.prediction.of_use]
    if (judged := steps.get("planar_validation", ValidationFile)) is not None:
        score, used = judged.file.models[judged.file.best], judged.file.runs.used
        if score.rmse is not None:
            parts.append(
                f"Driven by the commands of {used} run{'s' * (used != 1)} it misses the heading by "
                f"**{number(score.rmse, 3)}** degrees rms over whole runs."
            )
    parts.append(_lacks(lacks))
    if any(parts):
        yield " ".join(filter(None, parts))


def refusals(done: Sequence[StepDone]) -> Iterator[str]:
    """A line for each step that was refused: why."""
    return (f"**{one.step} was refused:** {escape(one.refused)}" for one in done if one.refused)


def missing_sentence(steps: Steps, done: Sequence[StepDone]) -> str:
    """Which steps left nothing to report, and why where that is not told as a refusal."""
    only_force = any(not one.always and one.name in steps.found for one in steps.places) and "yaw" not in steps.found
    fates = {one.step: one for one in done}
    missing: dict[str, list[str]] = {}
    for one in steps.places:
        fate = fates.get(one.step)
        passed = only_force and one.name in ("yaw", "validation", "diagnosis")
        if one.name in steps.missing and not passed and not (fate and fate.refused):
            words = f"no {one.kind.words.removeprefix('a ').removeprefix('an ')}"
            missing.setdefault((fate.skipped if fate else None) or "", []).append(words)
    said = []
    for why, lack in missing.items():
        lacking = listed(lack)
        why = escape(why) or ("that step was not run" if len(lack) == 1 else "those steps were not run")
        said.append(f"{lacking[0].upper()}{lacking[1:]}: {why}.")
    return " ".join(said)


def _model(step: StepResult[ModelFile], lacks: StepResult[DiagnosisFile] | None) -> str:
    """Law and parameters of the final model: with what was missing, where a diagnosis named it."""
    file, own = step.file, step.dof.symbols
    keys = {own.quadratic_print: own.quadratic}
    before = {name: step.known(given, f"models.{file.preferred}.{name}") for name, given in file.main_parameters()}
    linear, quadratic = f"{own.linear} {own.velocity}", f"{own.quadratic_print} |{own.velocity}| {own.velocity}"
    law = {"1": f" {linear}", "2": f" {quadratic} + {linear}", "3": f" {quadratic}"}.get(file.preferred, "")
    model = f"model {escape(file.preferred)} (drag{law})"
    final = {name: _after(lacks, keys.get(name, name)) for name in before}
    if not any(final.values()):
        return f"{model} fits {file.runs.used} runs best, with {_values(before)}"
    added = {name: one for name, one in final.items() if one is not None}
    alone = " and ".join(number(one.value) for one in before.values())
    return (
        f"with {added_by(lacks)} added, {model} has {_values(added)} (without, the fit to {file.runs.used} runs gives "
        f"{alone})"
    )


def added_by(step: StepResult[DiagnosisFile] | None) -> str:
    """What a diagnosis of a motion named and added to its model."""
    if step is None or step.file.verdict != "named" or step.file.of_thrusters:
        return ""
    return " and ".join(escape(effect.name) for effect in step.file.effects)


def _after(step: StepResult[DiagnosisFile] | None, key: str) -> Estimate | None:
    """A parameter of the model with what was missing, where that was named."""
    moved = step.file.base.get(key) if step is not None and added_by(step) else None
    return None if moved is None else moved.after.estimate


def _values(found: Mapping[str, Estimate]) -> str:
    said = " and ".join(_bold(name, one) for name, one in found.items())
    loose = [name for name, one in found.items() if not _determined(one)]
    return f"{said}; these runs do not determine {' and '.join(loose)}" if loose else said


def _determined(estimate: Estimate) -> bool:
    """Whether an interval is narrower than its number, and so tells it from zero."""
    low, high = estimate.ci95
    return low * high > 0 and high - low <= 2 * abs(estimate.value)


def _bold(name: str, estimate: Estimate) -> str:
    """A parameter with its interval, in bold where the runs determine it."""
    said = f"{name} = {escape(interval(estimate))}"
    return f"{f'**{said}**' if _determined(estimate) else said} {estimate.unit}".rstrip()


def _thrust(step: StepResult[ThrusterFile]) -> str:
    file = step.file
    if file.form == "square":
        laws = ((file.forward.a, "ahead"), (file.backward.a, "astern"))
        sides = [f"{number(a.value)} {side}" for a, side in laws if a is not None]
        return f"one thruster gives F = a |n| n with a = {' and '.join(sides)} N/n²" if sides else ""
    equation = next((one.equation for one in file.forms if one.form == file.form), file.form)
    chosen = file.chosen.rmse_percent_of_full_scale if file.chosen else None
    errors = [number(one, 2) for one in (chosen, file.rmse_percent_of_full_scale)]
    return f"one thruster gives {escape(equation)} to {errors[0]} % of full scale (the square law to {errors[1]} %)"


def _predicts(step: StepResult[ValidationFile] | None, fitted: StepResult[ModelFile] | None, added: str) -> str:
    """How far the model that was fitted is from runs, without what was `added` to it since."""
    if step is None:
        return ""
    file, words = step.file, step.dof.words
    model, used = file.preferred_by_fit if file.preferred_by_fit in file.models else file.best, file.runs.used
    score, best = file.models[model], file.models[file.best]
    runs = f"{used} run{'s' * (used != 1)}{_seen(step, fitted)}"
    driven = f"{f'Without {added}, driven' if added else 'Driven'} by the commands of {runs}, model {escape(model)}"
    if score.rmse is None:
        return f"{driven} diverges."
    again, error = score.restarted, _bracketed(score) if added else f"**{_bracketed(score)}**"
    restarted = f", by {number(again, 3)} {words.units} when restarted within them" if again is not None else ""
    better = f" (best is model {escape(file.best)} with {_bracketed(best)})" if best is not score else ""
    return (
        f"{driven} misses the {words.position} by "
        f"{error} {words.units} rms over whole runs{better}{restarted}, where the noise is "
        f"{number(file.noise_floor, 3)}."
    )


def _bracketed(score: Score) -> str:
    """The free-run error with its interval over runs, where there is one."""
    value = number(score.rmse, 3)
    return f"{value} \\[{number(score.ci95[0], 3)}, {number(score.ci95[1], 3)}\\]" if score.ci95 else value


def _seen(step: StepResult[ValidationFile], fitted: StepResult[ModelFile] | None) -> str:
    """Whether the logs of the validation had been fitted, by their content."""
    if fitted is None or fitted.manifest is None or step.manifest is None:
        return ""
    known = {entry.sha256 for entry in fitted.manifest.inputs if entry.role == "log"}
    again = [entry for entry in step.manifest.inputs if entry.role == "log" and entry.sha256 in known]
    if again:
        return f" ({len(again)} of the logs had been fitted)"
    return " that was not fitted" if step.file.runs.used == 1 else " that were not fitted"


def _lacks(step: StepResult[DiagnosisFile] | None) -> str:
    if step is None:
        return ""
    file = step.file
    words = "newtons" if file.of_thrusters else step.dof.words.units

    def sizes(gap: GapSize) -> list[str]:
        values = (gap.before, gap.after, gap.noise_floor)
        return [number(value, 3) if file.of_thrusters else f"{value:.2f}" for value in values]

    before, after, noise = sizes(file.gap.fitted_runs)
    names = " and ".join(f"**{escape(effect.name)}**" for effect in file.effects)
    if file.verdict == "nothing-missing":
        return f"Nothing is missing that these runs could show: the gap is {before} {words}, the noise {noise}."
    if file.verdict == "unexplained":
        return (
            f"Something is missing that no effect of the library explains: the gap is {after} {words}, the noise "
            f"{noise}."
        )
    if file.verdict == "suspected":
        return f"Suspected, and not added, is {names}. {escape(file.why)}"
    held, fitted, out = "", "", file.gap.held_out_runs
    if out is not None:
        held, fitted = " on what was held out", f" (from {before} to {after} on what was fitted)"
        before, after, noise = sizes(out)
    return (
        f"The {'thruster map' if file.of_thrusters else 'model'} lacks {names}: with it the gap{held} falls from "
        f"{before} to {after} {words}{fitted}, where the noise is {noise}."
    )
