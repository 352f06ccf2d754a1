"""A campaign's report as Markdown: from its step folders one document for a person, which the page renders."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.fits.channel_noise import sentences_of
from automarine_cli.pipeline.manifest import Manifest
from automarine_cli.pipeline.results_folder import file_stems
from automarine_cli.report.campaign_steps import StepResult, Steps, folder_of
from automarine_cli.report.campaign_summary import added_by, missing_sentence, refusals, summary
from automarine_cli.report.diagnosis_page import escape
from automarine_cli.report.tables import Table, interval
from automarine_cli.results.judged import CheckFile, DiagnosisFile, StepDone, ValidationFile
from automarine_cli.results.models import ModelFile, PlanarFile, ThrusterFile
from automarine_cli.results.records import ResultRecord

SHOWN_OPEN, MOST_SHOWN = 6, 40  # runs whose validation figure stands open, and that are in the page at all
MOST_ROWS = 1000  # of a folded table: a page of ten thousand rows opens slowly and is read by nobody
NEXT = "What to run next"


def alternatives(dof: Dof) -> dict[str, str]:
    """What each figure shows, in words, by its name."""
    words = dof.words
    position = words.position.capitalize()
    return {
        "thrusters": "Thrust of one thruster against its control signal: measured points, fitted curves, residuals "
        "below",
        dof.steps_key: f"{position} against time of every {words.step}: the part that was fitted in colour, what was "
        "cut in grey",
        "drag": f"Steady {words.rate} against {words.full_force}: one point a run, the curves of models 1, 2 and 3, "
        "residuals below",
        "inertia": f"{words.full_inertia.capitalize()} of each run against its {words.force}, with the overall value "
        "of both methods",
        "collapse": f"{position} against time times the root of the {words.force}: all runs on one curve if model 3 "
        "holds",
        "whole_runs": f"What the model leaves of the {words.position} of whole runs, beside the noise",
        "where": f"Where the gap between simulated and measured {words.position} is: against each variable that stands "
        "out",
        "why": f"Evidence for each effect of the library, and how the runs' own drag and {words.inertia} drift",
        "learned": "Learned curve, which no effect of the library explains, with its 95 % confidence band",
        "before_after": "The gap before and after the missing effect was added, against the noise of the "
        f"{words.position}",
    }


def document(
    steps: Steps,
    title: str,
    cautions: Sequence[str] = (),
    also: Mapping[str, str] | None = None,
    done: Sequence[StepDone] = (),
) -> str:
    """The whole report in Markdown; places of pictures are relative to the folder that holds the step folders.

    `cautions` are sentences about what does not fit together between the thruster tests and the vehicle; `also` are
    pages of other commands, by heading; `done` is what `run` says of its steps.
    """
    sections = {
        "Thruster map": _thrusters(steps, cautions),
        **{heading: blocks for dof in DOFS.values() for heading, blocks in _of_motion(steps, dof)},
        **dict(_together(steps)),
        **{heading: [body] for heading, body in (also or {}).items()},
        "Logs": _logs(steps),
        "Runs set aside": _set_aside(steps),
        NEXT: _next(steps),
        "How this was made": _made(steps),
    }
    parts = [f"# {escape(title)}", *refusals(done), *summary(steps), missing_sentence(steps, done)]
    for heading, blocks in sections.items():
        parts += [f"## {heading}", *blocks] if blocks else []
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def usual_title(steps: Steps) -> str:
    """The title of who gives none: the motions of which there is something."""
    motions = [
        dof.name
        for dof in DOFS.values()
        if any(name in steps.found for name in (dof.name, folder_of(dof, "validation"), folder_of(dof, "diagnosis")))
    ]
    return f"{' and '.join(motions or [YAW.name])} identification".capitalize()


def _of_motion(steps: Steps, dof: Dof) -> Iterator[tuple[str, list[str]]]:
    """The sections of one motion; those of yaw, which every campaign has, need no name."""
    within = "" if dof is YAW else f" in {dof.name}"
    yield f"{dof.name.capitalize()} model", _model(steps, dof)
    yield f"Validation{within}", _validation(steps, folder_of(dof, "validation"))
    yield f"Diagnosis{within}", _diagnosis(steps, folder_of(dof, "diagnosis"))


def _together(steps: Steps) -> Iterator[tuple[str, list[str]]]:
    """The sections of surge, sway and yaw together."""
    if (step := steps.get("planar", PlanarFile)) is not None:
        shown = "Of each run the heading with predictions"
        yield "Planar model", [step.text("planar.md"), picture(step, "planar_runs", shown)]
    yield "Planar validation", _validation(steps, "planar_validation")
    yield "Planar diagnosis", _diagnosis(steps, "planar_diagnosis")


def picture(step: StepResult[ResultRecord], stem: str, alt: str = "") -> str:
    """The line that shows a figure of a step; nothing if it was not drawn."""
    kinds = [kind for kind in ("png", "svg") if (step.folder / f"{stem}.{kind}").is_file()]
    return f"![{escape(alt or alternatives(step.dof)[stem])}]({step.name}/{stem}.{kinds[0]})" if kinds else ""


def fold(summary: str, *blocks: str) -> list[str]:
    """Blocks that are folded away behind their summary."""
    return [f"<details><summary>{summary}</summary>", *blocks, "</details>"]


def _thrusters(steps: Steps, cautions: Sequence[str]) -> list[str]:
    if (step := steps.get("thrusters", ThrusterFile)) is None:
        return []
    body = re.sub(r"\A# .*\n", "", step.text("thrusters.md"))
    return [picture(step, "thrusters"), body, _bullets([escape(f"Caution: {line}") for line in cautions])]


def _model(steps: Steps, dof: Dof) -> list[str]:
    if (step := steps.get(dof.name, ModelFile)) is None:
        return []
    names = added_by(steps.get(folder_of(dof, "diagnosis"), DiagnosisFile))
    blocks = (
        [f"This is the model without {names}, which the diagnosis added: the final numbers are at the top."]
        if names
        else []
    )
    blocks.append(escape(step.file.preferred_because))
    if step.file.ratio is not None:
        length, own = escape(interval(step.known(step.file.ratio, dof.ratio_key))), dof.symbols
        blocks.append(
            f"The {dof.words.inertial_length} {own.inertia}/{own.quadratic_print} is {length} {dof.units.base}, "
            f"whatever the unit of the {dof.words.force}."
        )
    blocks += [escape(line) for line in sentences_of(step.file.channels, dof)]
    if step.file.buoyancy is not None:
        blocks.append(escape(step.file.buoyancy.says))
    tables = [re.sub(r"\A\*\*(.*)\*\*", r"### \1", step.text(f"{table}.md")) for table in ("table1", "table2")]
    noted = "\n".join(tables)
    warnings = [escape(line) for line in step.file.warnings]
    blocks += [*tables, _bullets([f"Warning: {line}" for line in warnings if line not in noted])]
    figures = ("drag", "inertia", dof.steps_key, "collapse", "whole_runs")
    shown = [picture(step, stem) for stem in figures]
    return [*blocks, "### Figures of the fit", *shown]


def _validation(steps: Steps, folder: str) -> list[str]:
    if (step := steps.get(folder, ValidationFile)) is None:
        return []
    words, names = step.dof.words, list(step.file.logs)
    shown = [
        picture(
            step,
            f"validation_{stem}",
            f"Run {one}: measured and simulated {words.position}, their difference, the {words.force}",
        )
        for one, stem in islice(zip(names, file_stems(names)), MOST_SHOWN)
    ]
    blocks = [step.text("validation.md"), "### Run by run", *shown[:SHOWN_OPEN]]
    if shown[SHOWN_OPEN:]:
        blocks += fold(f"{len(shown) - SHOWN_OPEN} more runs", *shown[SHOWN_OPEN:])
    if len(names) > MOST_SHOWN:
        blocks.append(f"The figures of {len(names) - MOST_SHOWN} more runs are in the folder {step.name}.")
    return blocks


def _diagnosis(steps: Steps, folder: str) -> list[str]:
    if (step := steps.found.get(folder)) is None:
        return []
    body, _ = _without_next(step)
    body = re.sub(r"\A# .*\n", "", body)
    body = re.sub(r"^## ", "### ", body, flags=re.MULTILINE)

    def shown(found: re.Match[str]) -> str:
        return picture(step, found[1]) if found[1] in alternatives(step.dof) else ""

    return [re.sub(r"^!\[.*\]\((\w+)\.\w+\)$", shown, body, flags=re.MULTILINE)]


def _without_next(step: StepResult[ResultRecord]) -> tuple[str, str]:
    """The page of the diagnosis without, and only, what it says to run next."""
    text = step.text("diagnosis.md")
    found = re.search(rf"^## {NEXT}\n(.*?)(?=^## |\Z)", text, flags=re.MULTILINE | re.DOTALL)
    return (text.replace(found[0], ""), found[1]) if found else (text, "")


def _logs(steps: Steps) -> list[str]:
    if (step := steps.get("check", CheckFile)) is None or not (body := step.text("check.md")):
        return []
    used, count = step.file.runs.used, step.file.logs
    return [
        f"{count} log{'s' * (count != 1)} with {used} run{'s' * (used != 1)} or thruster tests checked.",
        *_listed("Every run", body, "check/check.md"),
    ]


def _set_aside(steps: Steps) -> list[str]:
    rows: dict[tuple[str, str, str], list[str]] = {}
    for step in steps.found.values():
        for run in step.file.runs.set_aside:
            rows.setdefault((run.file, run.run, run.why), []).append(step.name)
    if not rows:
        return []
    table = Table(
        "", ("log", "run", "why", "left out of"), tuple((*key, ", ".join(names)) for key, names in rows.items())
    )
    return [table.to_markdown()]


def _next(steps: Steps) -> list[str]:
    """What the diagnoses ask for, and warnings of preferred models that ask for runs."""
    fits = [fit for name in DOFS if (fit := steps.get(name, ModelFile)) is not None]
    of_others = re.compile(r"Model (\d) ")
    said = [
        escape(line)
        for fit in fits
        for line in fit.file.warnings
        if re.search(r"\badd\b", line, flags=re.IGNORECASE)
        and not ((other := of_others.match(line)) and other[1] != fit.file.preferred)
    ]
    diagnoses = [step for step in steps.found.values() if isinstance(step.file, DiagnosisFile)]
    blocks = [_bullets(said), *(_without_next(step)[1] for step in diagnoses)]
    lines = [block.strip() for block in blocks if block.strip()]
    if lines:
        return ["\n".join(lines)]
    without = "" if diagnoses else "; a diagnosis would say what these runs cannot show"
    return [f"No further runs are suggested{without}."]


def _bullets(lines: Sequence[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def _made(steps: Steps) -> list[str]:
    """Command, settings, versions and inputs of each step, from the manifests."""
    known = [(step, step.manifest) for step in steps.found.values() if step.manifest is not None]
    if not known:
        return []
    rows = []
    for step, made in known:
        seed, settings = "" if made.seed is None else str(made.seed), _settings(made.options)
        rows.append((step.name, f"automarine {made.command}", settings, seed, str(len(made.inputs)), made.automarine))
    header = ("folder", "command", "non-default settings", "seed", "inputs", "automarine")
    versions = {", ".join(f"{name} {one}" for name, one in made.libraries.items()) for _, made in known}
    return [
        Table("", header, tuple(rows)).to_markdown(),
        *(f"Versions: {escape(line)}." for line in sorted(versions)),
        "`automarine verify` on each folder says whether anything in it has changed.",
        *_listed("Every input and its SHA-256", _files(known), "manifest.json"),
    ]


def _files(known: Sequence[tuple[StepResult[ResultRecord], Manifest]]) -> str:
    """Every input of every step with its hash."""
    rows = [
        (step.name, entry.role, entry.file, entry.sha256 or "not readable")
        for step, made in known
        for entry in made.inputs
    ]
    return Table("", ("folder", "as", "file", "SHA-256"), tuple(rows)).to_markdown()


def _listed(summary: str, table: str, place: str) -> list[str]:
    """A long table folded away; of a very long one only where it stands."""
    return fold(summary, table) if table.count("\n") <= MOST_ROWS else [f"{summary}: see `{place}`."]


def _settings(options: Mapping[str, object]) -> str:
    """Settings that say something: not those left alone, nor how figures are stored."""
    told = {key: value for key, value in options.items() if value not in (None, False, [], "", "auto")}
    plain = {key: value for key, value in told.items() if not isinstance(value, (dict, list)) and value is not True}
    flags = [key for key, value in told.items() if value is True and key != "figures"]
    return ", ".join([*(f"{key} {value}" for key, value in plain.items()), *flags]) or "none"
