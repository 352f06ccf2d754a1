"""A campaign in three sentences: what was identified, how well it predicts, what it lacks."""

from collections.abc import Iterator

from automarine_cli.dofs import TRANSLATIONS, Dof
from automarine_cli.pipeline.words import listed
from automarine_cli.report.campaign_steps import StepResult, Steps, folder_of
from automarine_cli.report.diagnosis_page import escape
from automarine_cli.report.tables import interval, number
from automarine_cli.results.judged import DiagnosisFile, GapSize, Score, ValidationFile
from automarine_cli.results.models import ModelFile, PlanarFile, ThrusterFile

MASSES = ("surge.m_u", "sway.m_v", "yaw.I_r")


def summary(steps: Steps) -> Iterator[str]:
    """One paragraph of at most three sentences; nothing where there is only a look at the logs."""
    said = [
        sentence
        for sentence in (
            _identified(steps),
            _predicts(steps.get("validation", ValidationFile), steps.get("yaw", ModelFile)),
            _lacks(steps.get("diagnosis", DiagnosisFile)),
        )
        if sentence
    ]
    if said:
        yield " ".join(said)
    for dof in TRANSLATIONS.values():
        yield from _of_force(steps, dof)
    yield from _together(steps)


def _together(steps: Steps) -> Iterator[str]:
    """The same of surge, sway and yaw together."""
    parts = []
    if (model := steps.get("planar", PlanarFile)) is not None:
        found = [
            f"**{name} = {escape(interval(estimate))}** {estimate.unit}"
            for name, one in model.file.parameters.items()
            if name in MASSES and (estimate := one.estimate) is not None
        ]
        parts.append(f"Surge, sway and yaw together: {escape(model.file.structure)}, with {listed(found)}.")
        parts += [escape(line) for line in (model.file.prediction.says[:1] if model.file.prediction else ())]
    if (judged := steps.get("planar_validation", ValidationFile)) is not None:
        score, used = judged.file.models[judged.file.best], judged.file.runs.used
        if score.rmse is not None:
            parts.append(
                f"Driven by the commands of {used} run{'s' * (used != 1)} it misses the heading by "
                f"**{number(score.rmse, 3)}** degrees rms over whole runs."
            )
    parts += [one for one in (_lacks(steps.get("planar_diagnosis", DiagnosisFile)),) if one]
    if parts:
        yield " ".join(parts)


def _of_force(steps: Steps, dof: Dof) -> Iterator[str]:
    """The same paragraph of another motion."""
    model = steps.get(dof.name, ModelFile)
    parts = []
    if model is not None:
        parts.append(f"In {dof.name}, {_model(model)}.")
        if model.file.buoyancy is not None:
            parts.append(escape(model.file.buoyancy.says))
    judged = steps.get(folder_of(dof, "validation"), ValidationFile)
    lacks = steps.get(folder_of(dof, "diagnosis"), DiagnosisFile)
    parts += [one for one in (_predicts(judged, model), _lacks(lacks)) if one]
    if parts:
        yield " ".join(parts)


def missing_sentence(steps: Steps) -> str:
    """Which steps left nothing to report."""
    only_force = any(not one.always and one.name in steps.found for one in steps.places) and "yaw" not in steps.found
    missing = [
        one.kind.words
        for one in steps.places
        if one.name in steps.missing and not (only_force and one.name in ("yaw", "validation", "diagnosis"))
    ]
    if not missing:
        return ""
    lack = [f"no {words.removeprefix('a ').removeprefix('an ')}" for words in missing]
    why = "that step was not run" if len(missing) == 1 else "those steps were not run"
    said = listed(lack)
    return f"{said[0].upper()}{said[1:]}: {why}."


def _identified(steps: Steps) -> str:
    model, tested = steps.get("yaw", ModelFile), steps.get("thrusters", ThrusterFile)
    parts = [_model(model) if model else "", _thrust(tested) if tested else ""]
    said = "; ".join(part for part in parts if part)
    return f"{said[:1].upper()}{said[1:]}." if said else ""


def _model(step: StepResult[ModelFile]) -> str:
    """Law and parameters of the preferred model."""
    file, own = step.file, step.dof.symbols
    found = [
        f"**{name} = {escape(interval(estimate))}** {estimate.unit}"
        for name, given in file.main_parameters()
        for estimate in [step.known(given, f"models.{file.preferred}.{name}")]
    ]
    linear, quadratic = f"{own.linear} {own.velocity}", f"{own.quadratic_print} |{own.velocity}| {own.velocity}"
    law = {"1": f" {linear}", "2": f" {quadratic} + {linear}", "3": f" {quadratic}"}.get(file.preferred, "")
    return f"model {escape(file.preferred)} (drag{law}) fits {file.runs.used} runs best, with {' and '.join(found)}"


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


def _predicts(step: StepResult[ValidationFile] | None, fitted: StepResult[ModelFile] | None) -> str:
    if step is None:
        return ""
    file, words = step.file, step.dof.words
    model, used = file.preferred_by_fit if file.preferred_by_fit in file.models else file.best, file.runs.used
    score, best = file.models[model], file.models[file.best]
    runs = f"{used} run{'s' * (used != 1)}{_seen(step, fitted)}"
    if score.rmse is None:
        return f"Driven by the commands of {runs}, model {escape(model)} diverges."
    again = score.restarted
    restarted = f", by {number(again, 3)} {words.units} when restarted within them" if again is not None else ""
    better = f" (best is model {escape(file.best)} with {_bracketed(best)})" if best is not score else ""
    return (
        f"Driven by the commands of {runs}, model {escape(model)} misses the {words.position} by "
        f"**{_bracketed(score)}** {words.units} rms over whole runs{better}{restarted}, where the noise is "
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
    held, out = "", file.gap.held_out_runs
    if out is not None:
        held = " (from {} to {} on what was held out)".format(*sizes(out))
    return (
        f"The {'thruster map' if file.of_thrusters else 'model'} lacks {names}: with it the gap falls from {before} to "
        f"{after} {words}{held}, where the noise is {noise}."
    )
