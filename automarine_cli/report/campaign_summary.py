"""A campaign in three sentences: what was identified, how well it predicts, what it lacks."""

from collections.abc import Iterator, Mapping

from automarine_cli.dofs import Dof
from automarine_cli.pipeline.words import listed
from automarine_cli.report.campaign_steps import FORCES, OF_FORCE, RESULTS, StepResult, folder_of
from automarine_cli.report.diagnosis_page import escape
from automarine_cli.report.tables import interval, number

MASSES = ("surge.m_u", "sway.m_v", "yaw.I_r")

Steps = Mapping[str, StepResult]


def summary(steps: Steps) -> Iterator[str]:
    """One paragraph of at most three sentences; nothing where there is only a look at the logs."""
    said = [
        sentence
        for sentence in (
            _identified(steps),
            _predicts(steps.get("validation"), steps.get("yaw")),
            _lacks(steps.get("diagnosis")),
        )
        if sentence
    ]
    if said:
        yield " ".join(said)
    for dof in FORCES:
        yield from _of_force(steps, dof)
    yield from _together(steps)


def _together(steps: Steps) -> Iterator[str]:
    """The same of surge, sway and yaw together."""
    parts = []
    if (model := steps.get("planar")) is not None:
        found = [
            f"**{name} = {escape(interval(model.estimate('parameters', name)))}** {one['unit']}"
            for name, one in model.at("parameters").items()
            if name in MASSES and isinstance(one, dict)
        ]
        parts.append(f"Surge, sway and yaw together: {escape(str(model.at('structure')))}, with {listed(found)}.")
        parts += [escape(str(line)) for line in model.data.get("prediction", {}).get("says", [])[:1]]
    if (judged := steps.get("planar_validation")) is not None:
        score, used = judged.at("models", "planar"), judged.at("runs", "used")
        if score.get("heading_rmse_deg") is not None:
            parts.append(
                f"Driven by the commands of {used} run{'s' * (used != 1)} it misses the heading by "
                f"**{number(score['heading_rmse_deg'], 3)}** degrees rms over whole runs."
            )
    parts += [one for one in (_lacks(steps.get("planar_diagnosis")),) if one]
    if parts:
        yield " ".join(parts)


def _of_force(steps: Steps, dof: Dof) -> Iterator[str]:
    """The same paragraph of another motion."""
    model = steps.get(dof.name)
    parts = []
    if model is not None:
        parts.append(f"In {dof.name}, {_model(model)}.")
        if model.data.get("buoyancy"):
            parts.append(escape(str(model.at("buoyancy", "says"))))
    judged, lacks = (steps.get(folder_of(dof, step)) for step in ("validation", "diagnosis"))
    parts += [one for one in (_predicts(judged, model), _lacks(lacks)) if one]
    if parts:
        yield " ".join(parts)


def missing_sentence(steps: Steps) -> str:
    """Which steps left nothing to report."""
    only_force = any(name in steps for name in OF_FORCE) and "yaw" not in steps
    missing = [
        kind.words
        for name, kind in RESULTS.items()
        if name not in steps and not (only_force and name in ("yaw", "validation", "diagnosis"))
    ]
    if not missing:
        return ""
    lack = [f"no {words.removeprefix('a ').removeprefix('an ')}" for words in missing]
    why = "that step was not run" if len(missing) == 1 else "those steps were not run"
    said = listed(lack)
    return f"{said[0].upper()}{said[1:]}: {why}."


def _identified(steps: Steps) -> str:
    parts = [_model(steps["yaw"])] if "yaw" in steps else []
    parts += [_thrust(steps["thrusters"])] if "thrusters" in steps else []
    said = "; ".join(part for part in parts if part)
    return f"{said[:1].upper()}{said[1:]}." if said else ""


def _model(step: StepResult) -> str:
    """Law and parameters of the preferred model."""
    model, own = str(step.at("preferred")), step.dof.symbols
    names = {own.quadratic: own.quadratic_print, own.linear: own.linear, own.inertia: own.inertia}
    found = [
        f"**{name} = {escape(interval(estimate))}** {estimate.unit}"
        for key, name in names.items()
        if key in step.at("models", model)
        for estimate in [step.estimate("models", model, key)]
    ]
    runs, v = step.at("runs", "used"), own.velocity
    linear, quadratic = f"{own.linear} {v}", f"{own.quadratic_print} |{v}| {v}"
    law = {"1": f" {linear}", "2": f" {quadratic} + {linear}", "3": f" {quadratic}"}.get(model, "")
    return f"model {escape(model)} (drag{law}) fits {runs} runs best, with {' and '.join(found)}"


def _thrust(step: StepResult) -> str:
    form, ways = str(step.at("form")), (("forward", "ahead"), ("backward", "astern"))
    if form == "square":
        sides = [
            f"{number(step.number(key, 'a', 'value'))} {side}" for key, side in ways if step.at(key, "a") is not None
        ]
        return f"one thruster gives F = a |n| n with a = {' and '.join(sides)} N/n²" if sides else ""
    equation = next(one["equation"] for one in step.at("forms") if one["form"] == form)
    errors = [number(step.number(*at, "rmse_percent_of_full_scale"), 2) for at in (("chosen",), ())]
    return f"one thruster gives {escape(equation)} to {errors[0]} % of full scale (the square law to {errors[1]} %)"


def _predicts(step: StepResult | None, fitted: StepResult | None) -> str:
    if step is None:
        return ""
    best, fits = str(step.at("best")), str(step.at("preferred_by_fit"))
    model, used = fits if fits in step.at("models") else best, step.at("runs", "used")
    score, words, unit = step.at("models", model), step.dof.words, step.dof.units.key
    runs = f"{used} run{'s' * (used != 1)}{_seen(step, fitted)}"
    if score.get(f"rmse_{unit}") is None:
        return f"Driven by the commands of {runs}, model {escape(model)} diverges."
    again = score.get(f"restarted_rmse_{unit}")
    restarted = f", by {number(again, 3)} {words.units} when restarted within them" if again is not None else ""
    better = f" (best is model {escape(best)} with {_bracketed(step, best)})" if best != model else ""
    return (
        f"Driven by the commands of {runs}, model {escape(model)} misses the {words.position} by "
        f"**{_bracketed(step, model)}** {words.units} rms over whole runs{better}{restarted}, where the noise is "
        f"{number(step.number(f'noise_floor_{unit}'), 3)}."
    )


def _bracketed(step: StepResult, model: str) -> str:
    """The free-run error with its interval over runs, where there is one."""
    key = f"rmse_{step.dof.units.key}"
    value = number(step.number("models", model, key), 3)
    ends = step.at("models", model).get(f"{key}_ci95")
    return f"{value} \\[{number(ends[0], 3)}, {number(ends[1], 3)}\\]" if ends else value


def _seen(step: StepResult, fitted: StepResult | None) -> str:
    """Whether the logs of the validation had been fitted, by their content."""
    if fitted is None or fitted.manifest is None or step.manifest is None:
        return ""
    known = {entry.sha256 for entry in fitted.manifest.inputs if entry.role == "log"}
    again = [entry for entry in step.manifest.inputs if entry.role == "log" and entry.sha256 in known]
    if again:
        return f" ({len(again)} of the logs had been fitted)"
    return " that was not fitted" if step.at("runs", "used") == 1 else " that were not fitted"


def _lacks(step: StepResult | None) -> str:
    if step is None:
        return ""
    own = step.dof.units.key
    of_runs = f"before_{own}" in step.at("gap", "fitted_runs")
    unit, words = (own, step.dof.words.units) if of_runs else ("N", "newtons")

    def gap(runs: str) -> list[str]:
        values = (step.number("gap", runs, f"{name}_{unit}") for name in ("before", "after", "noise_floor"))
        return [f"{value:.2f}" if of_runs else number(value, 3) for value in values]

    before, after, noise = gap("fitted_runs")
    verdict = str(step.at("verdict"))
    if verdict == "nothing-missing":
        return f"Nothing is missing that these runs could show: the gap is {before} {words}, the noise {noise}."
    if verdict == "unexplained":
        return (
            f"Something is missing that no effect of the library explains: the gap is {after} {words}, the noise "
            f"{noise}."
        )
    if verdict == "suspected":
        names = " and ".join(f"**{escape(str(effect['name']))}**" for effect in step.at("effects"))
        return f"Suspected, and not added, is {names}. {escape(str(step.at('why')))}"
    model = "thruster map" if step.data.get("model") == "thruster-map" else "model"
    names = " and ".join(f"**{escape(str(effect['name']))}**" for effect in step.at("effects"))
    held = ""
    if step.at("gap", "held_out_runs"):
        held = " (from {} to {} on what was held out)".format(*gap("held_out_runs"))
    return (
        f"The {model} lacks {names}: with it the gap falls from {before} to {after} {words}{held}, where the noise is "
        f"{noise}."
    )
