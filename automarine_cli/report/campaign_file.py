"""The commented campaign file that `init` writes: what was seen beside every value, a question where it is not sure."""

import contextlib
import json
import os
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from automarine_cli.dofs import DOFS, PLANAR, YAW
from automarine_cli.logs import LogFile
from automarine_cli.logs.columns import BY, CANONICAL, OPEN, RUN, names_of, open_questions
from automarine_cli.logs.recognise import NEEDED, Layout, Recognised, in_newtons, places_of, pulses
from automarine_cli.logs.table import splitting
from automarine_cli.pipeline.records import Shown, everything, to_mapping
from automarine_cli.report.sections import Sections, sections, toml_line, toml_value
from automarine_cli.report.tables import Table, number
from automarine_cli.runs.look import UNITS_LINE, Placed, Survey
from automarine_cli.runs.run import runs_json
from automarine_cli.text import listed, plural, printable

SCHEMA = "automarine/campaign/1"
LINE_WIDTH = 120  # of a line with its comment; a longer one has it above
MAX_LISTED_LOGS = 20  # logs without a place that are listed
SAY = {
    "thrusters": "bollard tests",
    "steps": "one constant {force} each",
    "manoeuvres": "other runs: the diagnosis uses them too",
    "validation": "never fitted; move runs here that no fit may see",
    "runs": "any driving",
}
Line = str | tuple[str, object, str]
"""A line as it stands; or a key, its value, which is `OPEN` or has an open part where a person must say, and why."""


@dataclass(frozen=True, repr=False)
class NewCampaign(Shown):
    """The campaign file that was written, or would be, at `place`, and the keys that it still asks for; `pages` are
    the names of the figures of its runs in the folder `pictures` next to it."""

    survey: Survey
    text: str
    place: Path
    pages: tuple[str, ...] = ()

    @property
    def pictures(self) -> Path:
        return self.place.with_name(f"{self.place.stem}_runs")

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
                {"column": column.source, "taken_for": column.key, "unit": column.unit, "seen": column.evidence,
                 "open": column.open} | ({"rule": column.rule} if column.more else {})
                for column in look.columns
            ],
            "questions": list(self.questions),
            "campaign": self.text,
            **({"figures": [f"{self.pictures.name}/{page}" for page in self.pages]} if self.pages else {}),
            "runs": runs_json(sum(len(runs) for runs in look.runs.values()), look.set_aside),
        }  # fmt: skip


@sections.register
def _(result: NewCampaign) -> Sections:
    look, questions, count = result.survey, result.questions, len(result.pages)
    kinds = {kind: len(files) for kind, files in look.placed.items()}
    for motion, placed in look.forces.items():
        kinds |= {f"{motion}: {kind}": len(files) for kind, files in placed.items() if files}
    columns = [
        {"column": column.source, "read as": column.key + (f" less {column.neutral:g}" if column.neutral else ""),
         "values": column.evidence, "sure?": "asked" if column.open else "sure"}
        for column in look.columns
    ]  # fmt: skip
    asked = [f"{column.source}: {_question(column)}" for column in look.columns if column.open]
    offered = [column.source for column in look.columns if _is_offered(column)]
    offers = f": it offers to read {listed(offered)} too" if offered else ""
    to_answer = f"{plural(len(questions), 'question')} to answer: {', '.join(questions)}."
    return Sections([
        Table.of("Logs", [{"kind": kind, "logs": logs} for kind, logs in kinds.items()]),
        Table.of("Columns", columns, asked) if columns else f"No column is recognised; {UNITS_LINE}.",
        to_answer if questions else f"No open questions; check the file before running it{offers}.",
        *([f"Look at the runs: {plural(count, 'page')} of figures in {result.pictures}."] if count else ()),
        *(["Some logs are not used; the campaign file says which and why."] if "# Not used" in result.text else ()),
        *([f"Columns not read: {listed(look.unused)}."] if look.unused else ()),
        *([f"Commands and bollard tests do not fit: {look.misfit}."] if look.misfit else ()),
    ])  # fmt: skip


Ask = Callable[[str, str], str]
"""The answer to a question, by its key and its comment; an empty one leaves the question open."""


def new_campaign(look: Survey, files: Sequence[LogFile], place: Path, ask: Ask | None = None) -> NewCampaign:
    """Write the text of the campaign file at `place`, with logs as folders, globs and files relative to it."""
    home, top = place.parent.resolve(), look.folder.resolve()
    base = Path(os.path.relpath(top, home)).as_posix()
    inner = {file: file.path.resolve().relative_to(top).as_posix() for file in files}

    def logs_of(placed: Placed, motion: str = YAW.name) -> Iterator[Line]:
        for kind, members in placed.items():
            places = places_of([inner[file] for file in members], list(inner.values()))
            entries = [entry if base == "." else f"{base}/{entry}" for entry in places]
            seen = plural(len(members), "log") if motion == PLANAR.name else _seen(look, members)
            yield kind, entries, f"{DOFS.get(motion, YAW).fill(SAY[kind])}: {seen}"

    arm_m, arm = look.maps.user_map.defaults.get("arm_m"), "metres from the centre line to each thruster"
    drive = look.thrusters_drive
    moment = "logged, or thrusters: made of n_port and n_stbd by a thruster map and vehicle.arm_m"
    lines: list[Line] = [
        f"# A campaign of {plural(look.count, 'log')}, written by `automarine init` for `automarine run`.",
        f'# Check this file. A value "{OPEN}" is a question; `run` refuses the file until it is answered.',
        "",
        ("schema", SCHEMA, ""),
        ("title", printable(look.folder.resolve().name), "heading of the report"),
        "",
        "[vehicle]",
        '# name = ""  # as the report calls it',
        ("arm_m", arm_m or OPEN, arm) if arm_m or drive else f"# arm_m = 0.15  # {arm}",
        "# supply_V = 14.8  # supply of the vehicle in volts",
        "",
        "[logs]  # files, folders and globs, relative to this file",
        *logs_of(look.placed),
        *_not_used(look),
        "",
        "[columns]  # canonical name = the logs' name; a table may give unit, sign, subtract, scale, offset, sign_from",
        *_columns(look),
        *_thrusters(look),
        "",
        "[yaw]",
        ("moment", "thrusters" if drive else "logged", moment),
        'fit_to = "auto"  # auto, half-turns or whole-runs',
    ]
    for motion, placed in look.forces.items():
        lines += ["", *_motion(motion), *logs_of(placed, motion)]
    lines += [
        "",
        "# [tune]  # gains of a heading controller at the end: take the # of these lines away",
        '# target = "ardusub"  # or ardurover, pid',
        "# full = 1.0  # moment of the whole output, in the unit of the logs; or fly the thruster map:",
        "# thrusters = true",
    ]
    written = (printable(line) if isinstance(line, str) else _written(*line, ask) for line in lines)
    return NewCampaign(look, "\n".join(written) + "\n", place)


def _written(key: str, value: object, comment: str, ask: Ask | None) -> str:
    """A value and what is to be said of it; where it, or a part of it, is open, as it is answered."""
    if isinstance(value, dict):
        value = {name: _answer(part, f"{key}, {name}", comment, ask) for name, part in value.items()}
    value = _answer(value, key, comment, ask)
    is_open = any(part == OPEN for part, _ in everything(value))
    line, comment = toml_line(key, value), printable(f"? {comment}" if is_open else comment)
    if isinstance(value, list) and len(line) > LINE_WIDTH:
        line = f"{key} = [\n" + "".join(f"  {toml_value(entry)},\n" for entry in value) + "]"
    if not comment:
        return line
    return f"# {comment}\n{line}" if "\n" in line or len(line) + len(comment) > LINE_WIDTH else f"{line}  # {comment}"


def _answer(value: object, key: str, comment: str, ask: Ask | None) -> object:
    """A number, a list, true and false as they stand, anything else as text."""
    answer = ask(key, comment).strip() if ask and value == OPEN else ""
    with contextlib.suppress(ValueError):
        plain = json.loads(answer, parse_constant=str)
        return answer if plain is None or isinstance(plain, dict | str) else plain
    return answer or value


def _seen(look: Survey, files: Sequence[LogFile]) -> str:
    """`2 logs, 18 runs, -1.2 to 1.2 nu`, for the comment beside the logs of a kind."""
    text, runs = plural(len(files), "log"), [run for file in files for run in look.runs.get(file, ())]
    if runs:
        text += f", {plural(len(runs), 'run')}"
        if any(levels := [level for run in runs for level in run.levels or ()]):
            text += f", {number(min(levels), 3)} to {number(max(levels), 3)} {runs[0].moment_unit}"
    unread = len({*look.unread} & {*files})
    return f"{text}; {unread} of them show what they are once the questions are answered" if unread else text


def _not_used(look: Survey) -> Iterator[Line]:
    if look.maps.user_map.join:
        joined = "one log: columns of the second come onto the clock of the first, each value held until the next"
        yield "join", [to_mapping(join) for join in look.maps.user_map.join], joined
    if runs := look.not_used:
        yield f"# Not used: {len(runs)}"
        yield from (f"#   {run.file}{run.run and f', run {run.run}'}: {run.why}" for run in runs[:MAX_LISTED_LOGS])


def _motion(motion: str) -> Iterator[Line]:
    if motion == PLANAR.name:
        yield f"[{motion}]  # surge, sway and yaw together: `fit-planar` and its diagnosis"
        return
    dof = DOFS[motion]
    depths = "# depths = [0.3, 2.5]  # metres: follow steps between them, clear of surface and bottom"
    yield f"[{motion}]  # {dof.position} against {dof.words.force}; everything else as in yaw"
    within = "# within = 3.0  # metres from the start of a step, before the wall is felt"
    mass = "# mass = 38.0  # kg, with what floods it, for the metacentric height"
    yield mass if dof.restoring else depths if dof.windowed else within


def _thrusters(look: Survey) -> Iterator[Line]:
    if look.placed["thrusters"]:
        per_test = look.maps.user_map.defaults.get("thrusters_per_test")
        yield from ("", "[thrusters]")
        pulled = "how many equal thrusters pulled together? The logs cannot show it"
        yield "per_test", OPEN if per_test is None else int(per_test), pulled
        yield 'form = "auto"  # thrust curve: auto chooses by cross-validation'
    elif look.thrusters_drive:
        yield from ("", "[thrusters]")
        sources = [column.source for column in look.columns if column.key in YAW.thrusters]
        thrusts = all(map(in_newtons, sources))
        why = "a thrusters.json of this vehicle, as no bollard test makes one; or let tau be a sum of both (guide logs)"
        yield "map", *(("newtons", f"{listed(sources)} are thrusts by their names") if thrusts else (OPEN, why))


def _columns(look: Survey) -> Iterator[Line]:
    yield from _map(look.maps.shared, look)
    for logs, layouts in look.maps.apart:
        kind = "bollard tests" if layouts[0].bollard else "logs"
        yield from ("", f"[[columns_of]]  # the same for {kind} of other columns, by their names", ("logs", logs, ""))
        yield from _map(layouts, look)
    if look.maps.user_map.dbc:
        yield from ("", "[can]", ("dbc", look.maps.user_map.dbc, ""))


def _map(layouts: Sequence[Layout], look: Survey) -> Iterator[Line]:
    columns: dict[str, Recognised] = {}
    for column in (column for layout in layouts for column in layout.columns):
        columns.setdefault(column.key, column)
    yield from (_column(column, look) for column in columns.values())
    for layout in layouts:
        yield from _splitting(layout)
    there = {CANONICAL[key].quantity for key in columns}
    for quantity in dict.fromkeys(quantity for layout in layouts for quantity in layout.lacking):
        if quantity in there or quantity in YAW.thrusters or (quantity == YAW.command and look.thrusters_drive):
            continue
        names = listed(next(layout.names for layout in layouts if quantity in layout.lacking))
        sought = "control signal of the thruster" if quantity == "n" else quantity
        if quantity == YAW.command:
            sought += f" (or {' and '.join(YAW.thrusters)})"
            if signals := pulses(layouts[0].spans):  # commands about 1500 us
                rule = toml_line(YAW.thrusters[0], {"from": signals[0], "subtract": 1500})
                sought += f"; pulses such as {listed(signals)} are written {rule}"
        yield names_of(quantity)[0], OPEN, f"no column looks like the {sought}; the logs have {names}"


def _splitting(layout: Layout) -> Iterator[Line]:
    """Columns of a few words, which may name the thrusters of a bollard test or the runs of a table: a line where a
    column is called like that, else a comment that offers it."""
    sure = splitting(layout.words, layout.bollard).values()
    makes = "a map of each thruster, and one of all" if layout.bollard else "each a run of its own"
    for name, words in layout.words.items():
        key, text = BY if layout.bollard else RUN, f"{len(words)} names ({listed(words)}): {makes}"
        yield (key, name, text) if name in sure else f"# {toml_line(key, name)}  # {text}? Then write this line"


def _is_offered(column: Recognised) -> bool:
    """Whether the file offers a column in a comment, as nothing depends on it."""
    needed = CANONICAL[column.key].quantity in (*NEEDED, *YAW.thrusters, "n", "force")
    return bool(column.open) and not column.ask and not needed


def _question(column: Recognised) -> str:
    answer = f'Then write "{column.source}"'
    return column.open.replace(answer, "Then take the # before its line away") if _is_offered(column) else column.open


def _column(column: Recognised, look: Survey) -> Line:
    key, seen, rule, question = column.key, column.evidence, column.rule, _question(column)
    quantity, (followed, against) = CANONICAL[key].quantity, look.turns
    if quantity == YAW.position and followed + against:
        seen += f"; {YAW.words.moves} with the {YAW.words.force} in {followed} of {followed + against} steps"
    if _is_offered(column):
        return f"# {toml_line(key, column.source)}  # {seen}; {question}"
    if question and not column.ask:
        return key, OPEN, f"{column.source}, {seen}: {question}"
    if question:
        rule[column.ask] = OPEN
    if quantity == YAW.position and look.turned_round and "sign" not in column.more:
        rule["sign"] = OPEN
        why = "1 or -1: yaw and moment are both positive clockwise from above; one of them is not"
        question = "; ".join(filter(None, [why, question]))
    if question:
        return key, rule, f"{question}; seen: {seen}"
    if column.as_named:
        return f"# {key}  # as named: {seen}"
    return key, column.source if len(rule) == 1 else rule, seen
