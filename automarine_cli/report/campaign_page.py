"""A campaign's report as Markdown: from its step folders one document for a person, which the page renders."""

import re
from collections.abc import Mapping, Sequence
from itertools import islice

from automarine_cli.dofs import DOFS
from automarine_cli.pipeline.manifest import Manifest
from automarine_cli.pipeline.outputs import file_stems
from automarine_cli.report.campaign_steps import StepResult
from automarine_cli.report.campaign_summary import missing_sentence, summary
from automarine_cli.report.diagnosis_page import escape
from automarine_cli.report.tables import Table, interval

Steps = Mapping[str, StepResult]

ALT = {
    "thrusters": "Thrust of one thruster against its control signal: measured points, fitted curves, residuals below",
    "half_turns": "Heading against time of every half-turn: the part that was fitted in colour, what was cut in grey",
    "steps": "Heading against time of every half-turn: the part that was fitted in colour, what was cut in grey",
    "drag": "Steady yaw rate against yaw moment: one point a run, the curves of models 1, 2 and 3, residuals below",
    "inertia": "Yaw inertia of each run against its moment, with the overall value of both methods",
    "collapse": "Heading against time times the root of the moment: all runs on one curve if model 3 holds",
    "whole_runs": "Measured heading of each whole run, and that of the model",
    "where": "Where the gap between simulated and measured heading is: against each variable that stands out",
    "why": "Evidence for each effect of the library, and how the runs' own drag and inertia drift",
    "before_after": "The gap before and after the missing effect was added, against the noise of the heading",
}
FIGURES = ("drag", "inertia", "half_turns", "steps", "collapse", "whole_runs")
SHOWN_OPEN, MOST_SHOWN = 6, 40  # runs whose validation figure stands open, and that are in the page at all
MOST_ROWS = 1000  # of a folded table: a page of ten thousand rows opens slowly and is read by nobody
NEXT = "What to run next"


def document(steps: Steps, title: str, cautions: Sequence[str] = ()) -> str:
    """The whole report in Markdown; places of pictures are relative to the folder that holds the step folders.

    `cautions` are sentences about what does not fit together between the thruster tests and the vehicle.
    """
    sections = {
        "Thruster map": _thrusters(steps, cautions), "Yaw model": _yaw(steps), "Validation": _validation(steps),
        "Diagnosis": _diagnosis(steps), **_of_force(steps), "Logs": _logs(steps), "Runs set aside": _set_aside(steps),
        NEXT: _next(steps), "How this was made": _made(steps),
    }  # fmt: skip
    parts = [f"# {escape(title)}", *summary(steps), missing_sentence(steps)]
    for heading, blocks in sections.items():
        parts += [f"## {heading}", *blocks] if blocks else []
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def _of_force(steps: Steps) -> dict[str, list[str]]:
    """The sections of surge and heave."""
    return {
        heading: blocks
        for motion in ("surge", "heave")
        for heading, blocks in (
            (f"{motion.capitalize()} model", _yaw(steps, motion)),
            (f"Validation in {motion}", _validation(steps, f"{motion}_validation")),
            (f"Diagnosis in {motion}", _diagnosis(steps, f"{motion}_diagnosis")),
        )
    }


def picture(step: StepResult, stem: str, alt: str = "") -> str:
    """The line that shows a figure of a step; nothing if it was not drawn."""
    kinds = [kind for kind in ("png", "svg") if (step.folder / f"{stem}.{kind}").is_file()]
    return f"![{escape(alt or step.dof.say(ALT[stem]))}]({step.name}/{stem}.{kinds[0]})" if kinds else ""


def fold(summary: str, *blocks: str) -> list[str]:
    """Blocks that are folded away behind their summary."""
    return [f"<details><summary>{summary}</summary>", *blocks, "</details>"]


def _thrusters(steps: Steps, cautions: Sequence[str]) -> list[str]:
    if (step := steps.get("thrusters")) is None:
        return []
    body = re.sub(r"\A# .*\n", "", step.text("thrusters.md"))
    return [picture(step, "thrusters"), body, _bullets([escape(f"Caution: {line}") for line in cautions])]


def _yaw(steps: Steps, name: str = "yaw") -> list[str]:
    if (step := steps.get(name)) is None:
        return []
    say = step.dof.say
    blocks = [escape(str(step.at("preferred_because")))]
    if step.at("inertial_turn_angle_rad") is not None:
        turn = interval(step.estimate("inertial_turn_angle_rad"))
        blocks.append(
            say(f"The inertial turn angle I_r/k_r|r| is {escape(turn)} rad, whatever the unit of the moment.")
        )
    if step.data.get("buoyancy"):
        blocks.append(escape(str(step.at("buoyancy", "says"))))
    tables = [
        re.sub(r"\A\*\*(.*)\*\*", r"### \1", step.text(f"{table}.md")) for table in ("table1", "table2")
    ]
    noted = "\n".join(tables)
    warnings = [escape(str(line)) for line in step.at("warnings")]
    blocks += [*tables, _bullets([f"Warning: {line}" for line in warnings if line not in noted])]
    figures = [picture(step, stem) for stem in FIGURES]
    return [*blocks, "### Figures of the fit", *figures]


def _validation(steps: Steps, name: str = "validation") -> list[str]:
    if (step := steps.get(name)) is None:
        return []
    names = [str(one) for one in step.at("logs")]
    shown = [
        picture(
            step,
            f"validation_{stem}",
            f"Run {one}: " + step.dof.say("measured and simulated heading, their difference, the moment"),
        )
        for one, stem in islice(zip(names, file_stems(names)), MOST_SHOWN)
    ]
    blocks = [step.text("validation.md"), "### Run by run", *shown[:SHOWN_OPEN]]
    if shown[SHOWN_OPEN:]:
        blocks += fold(f"{len(shown) - SHOWN_OPEN} more runs", *shown[SHOWN_OPEN:])
    if len(names) > MOST_SHOWN:
        blocks.append(f"The figures of {len(names) - MOST_SHOWN} more runs are in the folder {step.name}.")
    return blocks


def _diagnosis(steps: Steps, name: str = "diagnosis") -> list[str]:
    if (step := steps.get(name)) is None:
        return []
    body, _ = _without_next(step)
    body = re.sub(r"\A# .*\n", "", body)
    body = re.sub(r"^## ", "### ", body, flags=re.MULTILINE)

    def shown(found: re.Match[str]) -> str:
        return picture(step, found[1]) if found[1] in ALT else ""

    return [re.sub(r"^!\[.*\]\((\w+)\.\w+\)$", shown, body, flags=re.MULTILINE)]


def _without_next(step: StepResult) -> tuple[str, str]:
    """The page of the diagnosis without, and only, what it says to run next."""
    text = step.text("diagnosis.md")
    found = re.search(rf"^## {NEXT}\n(.*?)(?=^## |\Z)", text, flags=re.MULTILINE | re.DOTALL)
    return (text.replace(found[0], ""), found[1]) if found else (text, "")


def _logs(steps: Steps) -> list[str]:
    if (step := steps.get("check")) is None or not (body := step.text("check.md")):
        return []
    used, count = step.at("runs", "used"), step.at("logs")
    return [
        f"{count} logs with {used} runs and thruster tests were looked at.",
        *_listed("Every run", body, "check/check.md"),
    ]


def _set_aside(steps: Steps) -> list[str]:
    rows: dict[tuple[str, str, str], list[str]] = {}
    for step in steps.values():
        for run in step.at("runs", "set_aside"):
            key = tuple(str(run.get(name, "")) for name in ("file", "run", "why"))
            rows.setdefault((key[0], key[1], key[2]), []).append(step.name)
    if not rows:
        return ["None: every run served in every step."]
    table = Table(
        "",
        ("log", "run", "why", "left out of"),
        tuple((*key, ", ".join(names)) for key, names in rows.items()),
    )
    return [table.to_markdown()]


def _next(steps: Steps) -> list[str]:
    warnings = [str(line) for name in DOFS if name in steps for line in steps[name].at("warnings")]
    said = [escape(line) for line in warnings if re.search(r"\badd\b", line, flags=re.IGNORECASE)]
    diagnoses = ("diagnosis", *(f"{name}_diagnosis" for name in DOFS))
    blocks = [_bullets(said), *(_without_next(steps[name])[1] for name in diagnoses if name in steps)]
    lines = [block.strip() for block in blocks if block.strip()]
    return (
        ["\n".join(lines)]
        if lines
        else ["Nothing stands out; a diagnosis would say what these runs cannot show."]
    )


def _bullets(lines: Sequence[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def _made(steps: Steps) -> list[str]:
    """Command, settings, versions and inputs of each step, from the manifests."""
    known = [(step, step.manifest) for step in steps.values() if step.manifest is not None]
    if not known:
        return []
    rows = []
    for step, made in known:
        seed, settings = "" if made.seed is None else str(made.seed), _settings(made.options)
        rows.append(
            (step.name, f"automarine {made.command}", settings, seed, str(len(made.inputs)), made.automarine)
        )
    header = ("folder", "command", "settings other than the usual", "seed", "inputs", "automarine")
    versions = {", ".join(f"{name} {one}" for name, one in made.libraries.items()) for _, made in known}
    return [
        Table("", header, tuple(rows)).to_markdown(),
        *(f"Versions: {escape(line)}." for line in sorted(versions)),
        "`automarine verify` on each folder says whether anything in it changed since; `automarine run --from` makes "
        "it again.",
        *_listed("Every input and its SHA-256", _files(known), "manifest.json"),
    ]


def _files(known: Sequence[tuple[StepResult, Manifest]]) -> str:
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
    plain = {
        key: value for key, value in told.items() if not isinstance(value, (dict, list)) and value is not True
    }
    flags = [key for key, value in told.items() if value is True and key != "figures"]
    return ", ".join([*(f"{key} {value}" for key, value in plain.items()), *flags]) or "none"
