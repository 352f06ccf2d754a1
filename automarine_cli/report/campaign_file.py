"""The commented campaign file that `init` writes: what was seen beside every value, a question where it is not sure."""

import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from textwrap import wrap

from automarine_cli.dofs import DOFS, YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.logs import LogFile
from automarine_cli.logs.columns import BY, CANONICAL, RUN, names_of
from automarine_cli.logs.recognise import NEEDED, Layout, Recognised, places_of, pulses
from automarine_cli.logs.table import splitting
from automarine_cli.pipeline.records import Shown, everything, to_mapping
from automarine_cli.report.sections import Sections, sections, toml_line
from automarine_cli.report.tables import Table, number
from automarine_cli.runs.look import Placed, RunKind, Survey
from automarine_cli.runs.run import runs_json
from automarine_cli.text import in_words, listed, printable

SCHEMA = "automarine/campaign/1"
OPEN = "?"  # a value that a person still has to give
COMMENTS = 44  # column at which comments stand, where the line is shorter
WIDEST = 120  # of a line with its comment, where the line is long
MOST_LISTED = 20  # logs without a place that are listed
SAY = {
    "thrusters": "bollard tests",
    "steps": "one constant {force} each",
    "manoeuvres": "other runs: the diagnosis uses them too",
    "validation": "never fitted",
    "runs": "any driving",
}
QUESTION = re.compile(r'^(?P<head>(?:[^#"]|"(?!\?")[^"]*")*)"\?"(?P<rest>.*)$')


@dataclass(frozen=True, repr=False)
class NewCampaign(Shown):
    """The campaign file that was written, or would be, at `place`, and the keys that it still asks for."""

    survey: Survey
    text: str
    place: Path

    @property
    def questions(self) -> tuple[str, ...]:
        return tuple(open_questions(tomllib.loads(self.text)))

    def to_json(self) -> dict[str, object]:
        look = self.survey
        names = {
            motion: {kind: [file.name for file in files] for kind, files in kinds.items()}
            for motion, kinds in {"placed": look.placed, **look.forces}.items()
        }
        return {
            "schema": "automarine/init/1", "logs": look.count, **names,
            "columns": [
                {"column": column.source, "taken_for": column.key, "unit": column.unit, "seen": column.seen,
                 "open": column.open} | ({"rule": column.rule} if column.more else {})
                for column in look.columns
            ],
            "questions": list(self.questions),
            "campaign": self.text,
            "runs": runs_json(sum(len(runs) for runs in look.runs.values()), look.set_aside),
        }  # fmt: skip


def answered(text: str, ask: Callable[[str, str], str]) -> str:
    """Put answers in place of the question marks of a campaign file; what gets none stays open.

    `ask` gets the key and the comment that goes with it. A number, a list and true or false stand as they are given,
    anything else is a text.
    """
    lines, before = text.split("\n"), ""
    for i, line in enumerate(lines):
        while (match := QUESTION.match(line)) is not None:
            key = match["head"].strip().rstrip("= ").replace(" = { from =", ", from").replace("{", "")
            comment = line.partition(" # ")[2] or (before if before.startswith("# ? ") else "")
            answer = ask(key.strip(), comment.removeprefix("# ").removeprefix("? ")).strip()
            if not answer or answer == OPEN:
                break
            line = f"{match['head']}{_as_toml(answer)}{match['rest']}"
        lines[i], before = line, line
    return "\n".join(lines)


def _as_toml(answer: str) -> str:
    try:
        value = tomllib.loads(f"x = {answer}")["x"]
    except tomllib.TOMLDecodeError:
        value = answer
    return toml_line("x", value).partition(" = ")[2] if isinstance(value, bool | int | float | list | str) else answer


def open_questions(data: object) -> list[str]:
    return [in_words(place).removesuffix(": ") for value, place in everything(data) if value == OPEN]


@sections.register
def _(result: NewCampaign) -> Sections:
    look, count = result.survey, len(result.questions)
    kinds = {kind: len(files) for kind, files in look.placed.items()}
    for motion, placed in look.forces.items():
        kinds |= {f"{motion}: {kind}": len(files) for kind, files in placed.items() if files}
    columns = [(column.source, _taken(column), column.seen, column.open or "sure") for column in look.columns]
    questions = f"{count} question{'s' * (count != 1)} to answer: {', '.join(result.questions)}."
    return Sections([
        Table.of("Logs", [{"kind": kind, "logs": logs} for kind, logs in kinds.items()]),
        Table("Columns", ("column", "taken for", "values", "sure or asked"), tuple(columns)),
        questions if count else "No open questions; check the file before running it.",
        *([f"Commands and bollard tests do not fit: {look.misfit}."] if look.misfit else ()),
    ])  # fmt: skip


def _taken(column: Recognised) -> str:
    less, way = column.more.get("subtract"), column.more.get("sign_from")
    subtracted = f" less {less:g}" if isinstance(less, int | float) else ""
    signed = way["from"] if isinstance(way, Mapping) else way
    return column.key + subtracted + (f", signed by {signed}" if signed else "")


Entries = Iterator[tuple[str, str, tuple[LogFile, ...]]]
"""Kind of logs, the line of the file that names them, and the logs."""


def new_campaign(look: Survey, files: Sequence[LogFile], place: Path) -> NewCampaign:
    """Write the text of the campaign file at `place`, with logs as folders, globs and files relative to it."""
    home, top = place.parent.resolve(), look.folder.resolve()
    base = Path(os.path.relpath(top, home)).as_posix()
    inner = {file: file.path.resolve().relative_to(top).as_posix() for file in files}

    def entries(placed: Placed) -> Entries:
        for kind, members in placed.items():
            places = places_of([inner[file] for file in members], list(inner.values()))
            yield kind, _list(kind, [entry if base == "." else f"{base}/{entry}" for entry in places]), members

    forces = (_force(look, motion, entries(placed)) for motion, placed in look.forces.items())
    logs, columns = _logs(look, entries(look.placed)), _columns(look)
    lines = chain(_vehicle(look), logs, columns, _settings(look), *forces, _tune(look))
    return NewCampaign(look, "\n".join(lines) + "\n", place)


def _beside(line: str, comment: str) -> str:
    if not comment:
        return line
    comment = printable(comment)
    if "\n" in line or (len(line) > COMMENTS and len(line) + len(comment) > WIDEST):
        return f"# {comment}\n{line}"
    return f"{line:<{COMMENTS}} # {comment}"


def _open(key: str, comment: str) -> str:
    return _beside(toml_line(key, OPEN), f"? {comment}")


def _vehicle(look: Survey) -> Iterator[str]:
    count, arm = look.count, look.maps.given.defaults.get("arm_m")
    yield f"# A campaign of {count} log{'s' * (count != 1)}, written by `automarine init` for `automarine run`."
    yield f'# Check this file. A value "{OPEN}" is a question; `run` refuses the file until it is answered.'
    yield ""
    yield toml_line("schema", SCHEMA)
    yield _beside(toml_line("title", printable(look.folder.resolve().name)), "heading of the report")
    yield ""
    yield "[vehicle]"
    yield _beside('# name = ""', "as the report calls it")
    meaning = "metres from the centre line to each thruster"
    if arm is not None:
        yield _beside(toml_line("arm_m", arm), f"{meaning}, as --columns says")
    elif look.thrusters_drive:
        yield _open("arm_m", f"{meaning}: the logs hold thruster commands, no moment")
    else:
        logged = f"the logs hold a moment, and the commands {listed(look.commands)} beside it: see [yaw] moment"
        none = "not needed, the logs hold no commands to make moments of"
        yield _beside("# arm_m = 0.15", f"{meaning}; {logged if look.commands else none}")
    volts = next((column for column in look.columns if column.key == "voltage_V"), None)
    voltage = f"the logs hold {volts.source}, {volts.seen}" if volts else "the logs hold no voltage"
    yield _beside("# supply_V = 14.8", f"supply of the vehicle in volts; {voltage}")
    yield ""


def _logs(look: Survey, entries: Entries) -> Iterator[str]:
    yield _beside("[logs]", "files, folders and globs, relative to this file")
    for kind, line, files in entries:
        summary = _counted(look.runs, files)
        if look.unread and kind == "steps":
            summary += f"; {len(look.unread)} of them show what they are once the questions are answered"
        if not files and kind == "validation":
            summary = "none found in a folder called validation; move runs here that no fit may see"
        yield _beside(line, f"{YAW.fill(SAY[kind])}: {summary}")
    if look.maps.join:
        joined = "one log: columns of the second come onto the clock of the first, each value held until the next"
        yield _beside(toml_line("join", [to_mapping(join) for join in look.maps.join]), joined)
    motions = {file: layout.dof for layout in look.layouts for file in layout.files}
    idle = [file for file, runs in look.runs.items() if runs and all(run.kind == "idle" for run in runs)]
    unused = [f"{file.name}: no {motions[file].words.force} acts in it" for file in idle]
    unused += [f"{run.file}, run {run.run}: {run.why}" for run in look.set_aside]
    unused += [f"{file.name}: no column looks like a heading, a moment or a command" for file in look.strangers]
    yield from [f"# Not used: {len(unused)}"] * bool(unused)
    yield from (f"#   {printable(line)}" for line in unused[:MOST_LISTED])
    yield from [f"#   and {len(unused) - MOST_LISTED} more"] * (len(unused) > MOST_LISTED)
    yield ""


def _counted(looked_at: Mapping[LogFile, Sequence[RunKind]], files: Sequence[LogFile]) -> str:
    """`2 logs, 18 runs, -1.2 to 1.2 nu`, for the comment beside the logs of a kind."""
    count = f"{len(files)} log{'s' * (len(files) != 1)}"
    runs = [run for file in files for run in looked_at.get(file, ())]
    if not runs:
        return count
    low, high = min(run.low for run in runs), max(run.high for run in runs)
    return f"{count}, {len(runs)} run{'s' * (len(runs) != 1)}, {number(low, 3)} to {number(high, 3)} {runs[0].unit}"


def _force(look: Survey, motion: str, entries: Entries) -> Iterator[str]:
    yield ""
    planar, dof = motion == PLANAR.name, DOFS.get(motion, YAW)
    about = f"{dof.position} against {dof.words.force}; everything else as in yaw"
    yield _beside(f"[{motion}]", "surge, sway and yaw together: `fit-planar` and its diagnosis" if planar else about)
    for kind, line, files in entries:
        yield _beside(line, f"{dof.fill(SAY[kind])}: {_counted({} if planar else look.runs, files)}")
    if dof.windowed:
        yield _beside("# depths = [0.3, 2.5]", "metres: follow steps between them, clear of surface and bottom")
    elif not planar:
        yield _beside("# within = 3.0", "metres from the start of a step, before the wall is felt")


def _tune(look: Survey) -> Iterator[str]:
    yield ""
    yield _beside("# [tune]", "gains of a heading controller at the end: take the # of these lines away")
    yield _beside('# target = "ardusub"', "or ardurover, pid, python")
    if look.thrusters_drive:
        yield _beside("# thrusters = true", "fly the thruster map, dead-band included")
    else:
        yield _beside("# full = 1.0", "moment of the whole output, in the unit of the logs")


def _list(key: str, places: Sequence[str]) -> str:
    line = toml_line(key, list(places))
    if len(line) <= WIDEST - 20:
        return line
    return f"{key} = [\n" + "".join(f"  {toml_line('', place).partition(' = ')[2]},\n" for place in places) + "]"


def _columns(look: Survey) -> Iterator[str]:
    rules = "canonical name = the logs' name; a table may give unit, sign, subtract, scale, offset, sign_from"
    yield _beside("[columns]", rules)
    yield from _map(look.maps.shared, look)
    for logs, layouts in look.maps.own:
        yield ""
        kind = "bollard tests" if layouts[0].bollard else "logs"
        yield _beside("[[columns_of]]", f"the same for {kind} of other columns, by their names")
        yield _list("logs", logs)
        yield from _map(layouts, look)
    if look.maps.given.dbc:
        yield from ("", "[can]", toml_line("dbc", look.maps.given.dbc))
    yield ""


def _map(layouts: Sequence[Layout], look: Survey) -> Iterator[str]:
    order = dict.fromkeys(column.key for layout in layouts for column in layout.columns)
    every = {column.key: column for layout in reversed(layouts) for column in layout.columns}
    for key in order:
        yield _column(every[key], look)
    yield from _splitting(layouts)
    there, written = {CANONICAL[key].quantity for key in every}, ""
    if columns := pulses(layouts[0].seen if layouts else {}):  # commands are pulses about 1500 us
        rule = toml_line(YAW.thrusters[0], {"from": columns[0], "subtract": 1500})
        written = f": pulses about 1500 us such as {listed(columns)} are written {rule}"
    for quantity in dict.fromkeys(quantity for layout in layouts for quantity in layout.lacking):
        if quantity in there or quantity in YAW.thrusters or (quantity == YAW.command and look.thrusters_drive):
            continue
        names, other = listed(next(layout.names for layout in layouts if quantity in layout.lacking)), ""
        if quantity == YAW.command:
            other = f" (or {' and '.join(YAW.thrusters)}{written})"
        sought = "control signal of the thruster" if quantity == "n" else quantity
        yield _open(names_of(quantity)[0], f"no column looks like the {sought}{other}; the logs have {names}")


def _splitting(layouts: Sequence[Layout]) -> Iterator[str]:
    """Columns of a few words, which may name the thrusters of a bollard test or the runs of a table: a line where one
    is called like that, else a comment that offers it."""
    for layout in layouts:
        sure = splitting(layout.words, layout.bollard).values()
        makes = "a map of each thruster, and one of all" if layout.bollard else "each a run of its own"
        for name, words in layout.words.items():
            text = f"{len(words)} names ({listed(words)}): {makes}"
            line = toml_line(BY if layout.bollard else RUN, name)
            yield _beside(line, text) if name in sure else _beside(f"# {line}", f"{text}? Then write this line")


def _column(column: Recognised, look: Survey) -> str:
    key, evidence, rule, question = column.key, column.seen, column.rule, column.open
    quantity, (followed, against) = CANONICAL[key].quantity, look.turns
    if quantity == YAW.position and followed + against:
        evidence += f"; {YAW.words.moves} with the {YAW.words.force} in {followed} of {followed + against} steps"
    if column.ask:
        return _beside(toml_line(key, {**rule, column.ask: OPEN}), f"? {question}; seen: {evidence}")
    if question and quantity not in (*NEEDED, *YAW.thrusters, "n", "force"):
        return f"# {_beside(toml_line(key, column.source), f'{evidence}; {question}')}"  # nothing depends on it
    if question and not column.unit_open:
        return _open(key, f"{column.source}, {evidence}: {question}")
    if question:
        rule["unit"] = OPEN
    if quantity == YAW.position and look.turned_round and "sign" not in column.more:
        rule["sign"] = OPEN
        why = "? 1 or -1: yaw and moment are both positive clockwise from above; one of them is not"
        return _beside(toml_line(key, rule), f"{why}. {evidence}" + (f"; ? {question}" if question else ""))
    if question:
        return _beside(toml_line(key, rule), f"? {question}; seen: {evidence}")
    if column.as_named:
        return _beside(f"# {key}", f"as named: {evidence}")
    return _beside(toml_line(key, column.source if len(rule) == 1 else rule), evidence)


def _settings(look: Survey) -> Iterator[str]:
    tested, pulling = look.placed["thrusters"], look.maps.given.defaults.get("thrusters_per_test")
    if tested:
        yield "[thrusters]"
        if pulling is None:
            yield _open("per_test", "how many equal thrusters pulled together? The logs cannot show it")
        else:
            yield _beside(
                toml_line("per_test", int(pulling)), "equal thrusters that pulled together, as --columns says"
            )
        yield _beside(toml_line("form", "auto"), "thrust curve: auto chooses by cross-validation")
        yield ""
    elif look.thrusters_drive:
        why = "a thrusters.json of this vehicle: there are no bollard tests to make one of"
        yield from ("[thrusters]", _open("map", why), "")
    yield "[yaw]"
    moment = "thrusters" if look.thrusters_drive else "logged"
    if look.misfit:
        yield from wrap(printable(look.misfit), WIDEST, initial_indent="# ", subsequent_indent="# ")
    choices = "logged, or thrusters: made of n_port and n_stbd by a thruster map and vehicle.arm_m"
    yield _beside(toml_line("moment", moment), choices)
    yield _beside(toml_line("fit_to", "auto"), "auto, half-turns or whole-runs")
