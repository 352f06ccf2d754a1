"""The commented campaign file that `init` writes: what was seen beside every value, a question where it is not sure."""

from collections.abc import Iterator, Mapping, Sequence
from textwrap import wrap

from automarine_cli.dofs import DOFS, YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.logs.canonical import BY, CANONICAL, RUN, names_of
from automarine_cli.logs.labels import splitting
from automarine_cli.logs.recognise import Recognised
from automarine_cli.logs.spans import pulses
from automarine_cli.pipeline.records import to_mapping, toml_line
from automarine_cli.pipeline.words import listed, printable
from automarine_cli.workflows.campaign_file import OPEN, SCHEMA
from automarine_cli.workflows.campaign_look import Look, moments_of
from automarine_cli.workflows.campaign_maps import NEEDED, Layout

COMMENTS = 44  # column at which comments stand, where the line is shorter
WIDEST = 120  # of a line with its comment, where the line is long
MOST_TOLD = 20  # logs without a place that are listed
_IN_WORDS = {"n": "control signal of the thruster"}
SAY = {
    "thrusters": "bollard tests",
    "steps": "one constant {force} each",
    "manoeuvres": "other runs: the diagnosis uses them too",
    "validation": "never fitted",
}


def campaign_text(
    look: Look, entries: Mapping[str, Sequence[str]], forces: Mapping[str, Mapping[str, Sequence[str]]] | None = None
) -> str:
    """The file's content; `entries` are folders, globs and files under `[logs]`, `forces` those of other motions."""
    parts = (
        _head(look),
        _vehicle(look),
        _logs(look, entries),
        _columns(look),
        _settings(look, entries),
        *(_force(look, motion, kinds) for motion, kinds in (forces or {}).items()),
        _tune(look),
    )
    return "\n".join(line for part in parts for line in part) + "\n"


def _beside(line: str, comment: str) -> str:
    if not comment:
        return line
    comment = printable(comment)
    if "\n" in line or (len(line) > COMMENTS and len(line) + len(comment) > WIDEST):
        return f"# {comment}\n{line}"
    return f"{line:<{COMMENTS}} # {comment}"


def _open(key: str, comment: str) -> str:
    """A question: the value is a question mark until a person answers."""
    return _beside(toml_line(key, OPEN), f"? {comment}")


def _head(look: Look) -> Iterator[str]:
    count = look.count
    yield f"# A campaign of {count} log{'s' * (count != 1)}, written by `automarine init` for `automarine run`."
    yield f'# Check this file. A value "{OPEN}" is a question; `run` refuses the file until it is answered.'
    yield ""
    yield toml_line("schema", SCHEMA)
    yield _beside(toml_line("title", printable(look.folder.resolve().name)), "heading of the report")
    yield ""


def _vehicle(look: Look) -> Iterator[str]:
    yield "[vehicle]"
    yield _beside('# name = ""', "as the report calls it")
    meaning = "metres from the centre line to each thruster"
    arm = look.maps.given.defaults.get("arm_m")
    if arm is not None:
        yield _beside(toml_line("arm_m", arm), f"{meaning}, as --columns says")
    elif look.thrusters_drive:
        yield _open("arm_m", f"{meaning}: the logs hold thruster commands, no moment")
    elif look.commands:
        both = f"the logs hold a moment, and the commands {listed(look.commands)} beside it"
        yield _beside("# arm_m = 0.15", f"{meaning}; {both}: see [yaw] moment")
    else:
        yield _beside("# arm_m = 0.15", f"{meaning}; not needed, the logs hold no commands to make moments of")
    volts = next((one for one in look.columns if one.key == "voltage_V"), None)
    seen = f"the logs hold {volts.source}, {volts.seen}" if volts else "the logs hold no voltage"
    yield _beside("# supply_V = 14.8", f"supply of the vehicle in volts; {seen}")
    yield ""


def _logs(look: Look, entries: Mapping[str, Sequence[str]]) -> Iterator[str]:
    yield _beside("[logs]", "files, folders and globs, relative to this file")
    for kind, places in entries.items():
        files = look.placed[kind]
        told = moments_of(look, files)
        seen = f"{len(files)} log{'s' * (len(files) != 1)}" + (f", {told}" if told else "")
        if look.unread and kind == "steps":
            seen += f"; {len(look.unread)} of them show what they are once the questions are answered"
        if not files and kind == "validation":
            seen = "none found in a folder called validation; move runs here that no fit may see"
        yield _beside(_list(kind, places), f"{YAW.fill(SAY[kind])}: {seen}")
    for one in look.maps.join:
        said = "one log: columns of the second come onto the clock of the first, each value held until the next"
        yield _beside(toml_line("join", [to_mapping(one) for one in look.maps.join]), said)
        break
    yield from _without_place(look)
    yield ""


def _force(look: Look, motion: str, entries: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """The section of a translation, or of surge, sway and yaw together."""
    yield ""
    if motion == PLANAR.name:
        yield _beside(f"[{motion}]", "surge, sway and yaw together: `fit-planar` and its diagnosis")
        for kind, places in entries.items():
            count = len(look.forces[motion][kind])
            said = SAY["validation"] if kind == "validation" else "any driving"
            yield _beside(_list(kind, places), f"{said}: {count} log{'s' * (count != 1)}")
        return
    dof = DOFS[motion]
    yield _beside(f"[{motion}]", f"{dof.position} against {dof.words.force}; everything else as in yaw")
    for kind, places in entries.items():
        files = look.forces[motion][kind]
        told = moments_of(look, files)
        seen = f"{len(files)} log{'s' * (len(files) != 1)}" + (f", {told}" if told else "")
        yield _beside(_list(kind, places), f"{dof.fill(SAY[kind])}: {seen}")
    if dof.windowed:
        yield _beside("# depths = [0.3, 2.5]", "metres: follow steps between them, clear of surface and bottom")
    else:
        yield _beside("# within = 3.0", "metres from the start of a step, before the wall is felt")


def _tune(look: Look) -> Iterator[str]:
    """A controller at the end, for who wants one."""
    yield ""
    yield _beside("# [tune]", "gains of a heading controller at the end: take the # of these lines away")
    yield _beside('# target = "ardusub"', "or ardurover, pid, labust, python")
    if look.thrusters_drive:
        yield _beside("# thrusters = true", "fly the thruster map, dead-band included")
    else:
        yield _beside("# full = 1.0", "moment of the whole output, in the unit of the logs")


def _list(key: str, places: Sequence[str]) -> str:
    line = toml_line(key, list(places))
    if len(line) <= WIDEST - 20:
        return line
    return f"{key} = [\n" + "".join(f"  {toml_line('x', one).partition(' = ')[2]},\n" for one in places) + "]"


def _without_place(look: Look) -> Iterator[str]:
    """Logs and runs that are in no list, each with its reason."""
    motions = {file: layout.dof for layout in look.layouts for file in layout.files}
    idle = [file for file, runs in look.runs.items() if runs and all(run.kind == "idle" for run in runs)]
    told = [f"{file.name}: no {motions[file].words.force} acts in it" for file in idle]
    told += [f"{one.file}, run {one.run}: {one.why}" for one in look.set_aside]
    told += [f"{file.name}: no column looks like a heading, a moment or a command" for file in look.strangers]
    if told:
        yield f"# Not used: {len(told)}"
    for line in told[:MOST_TOLD]:
        yield f"#   {printable(line)[:200]}"
    if len(told) > MOST_TOLD:
        yield f"#   and {len(told) - MOST_TOLD} more"


def _columns(look: Look) -> Iterator[str]:
    said = "canonical name = the logs' name; a table may give unit, sign, subtract, scale, offset, sign_from"
    yield _beside("[columns]", said)
    yield from _map(look.maps.shared, look)
    for logs, layouts in look.maps.own:
        yield ""
        kind = "bollard tests" if layouts[0].bollard else "logs"
        yield _beside("[[columns_of]]", f"the same for {kind} of other columns, by their names")
        yield _list("logs", logs)
        yield from _map(layouts, look)
    can = look.maps.given.dbc
    if can:
        yield ""
        yield "[can]"
        yield toml_line("dbc", can)
    yield ""


def _map(layouts: Sequence[Layout], look: Look) -> Iterator[str]:
    """The lines of layouts that share a map: each column once, then what is lacking."""
    every = {one.key: one for layout in reversed(layouts) for one in layout.columns}
    order = dict.fromkeys(one.key for layout in layouts for one in layout.columns)
    for key in order:
        yield _column(every[key], look)
    yield from _splitting(layouts)
    there = {CANONICAL[key].quantity for key in every}
    for quantity in dict.fromkeys(one for layout in layouts for one in layout.lacking):
        keys = names_of(quantity)
        if quantity in there or quantity in YAW.thrusters or (quantity == YAW.command and look.thrusters_drive):
            continue
        names = listed(next(layout.names for layout in layouts if quantity in layout.lacking))
        sides = " and ".join(YAW.thrusters)
        other = f" (or {sides}{_of_pulses(layouts)})" if quantity == YAW.command else ""
        yield _open(
            keys[0], f"no column looks like the {_IN_WORDS.get(quantity, quantity)}{other}; the logs have {names}"
        )


def _splitting(layouts: Sequence[Layout]) -> Iterator[str]:
    """Columns of a few words, which may name the thrusters of a bollard test or the runs of a table: a line where one
    is called like that, else a comment that offers it."""
    for layout in layouts:
        named = splitting(layout.words, layout.bollard).values()
        for name, words in layout.words.items():
            makes = "a map of each thruster, and one of all" if layout.bollard else "each a run of its own"
            sure = name in named
            told = f"{len(words)} names ({listed(words)}): {makes}" + ("" if sure else "? Then write this line")
            line = toml_line(BY if layout.bollard else RUN, name)
            yield _beside(line if sure else f"# {line}", told)


def _of_pulses(layouts: Sequence[Layout]) -> str:
    """How commands are written that are pulses about 1500 us, where some columns look like that."""
    found = pulses(layouts[0].seen)
    if not found:
        return ""
    rule = toml_line(YAW.thrusters[0], {"from": found[0], "subtract": 1500})
    return f": pulses about 1500 us such as {listed(found)} are written {rule}"


def _column(one: Recognised, look: Look) -> str:
    """One column: as named (a comment), mapped, or asked about."""
    quantity = CANONICAL[one.key].quantity
    sign = quantity == YAW.position and look.turned_round and "sign" not in one.more
    followed, against = look.turns
    seen = one.seen
    if quantity == YAW.position and followed + against:
        seen += f"; {YAW.words.moves} with the {YAW.words.force} in {followed} of {followed + against} steps"
    rule = one.rule
    if one.ask:
        return _beside(toml_line(one.key, {**rule, one.ask: OPEN}), f"? {one.open}; seen: {seen}")
    if one.open and quantity not in (*NEEDED, *YAW.thrusters, "n", "force"):
        return f"# {_beside(toml_line(one.key, one.source), f'{seen}; {one.open}')}"  # nothing depends on it
    if one.open and not one.unit_open:
        return _open(one.key, f"{one.source}, {seen}: {one.open}")
    if one.open:
        rule["unit"] = OPEN
    if sign:
        rule["sign"] = OPEN
        why = "? 1 or -1: yaw and moment are both positive clockwise from above; one of them is not"
        return _beside(toml_line(one.key, rule), f"{why}. {seen}" + (f"; ? {one.open}" if one.open else ""))
    if one.open:
        return _beside(toml_line(one.key, rule), f"? {one.open}; seen: {seen}")
    if one.as_named:
        return _beside(f"# {one.key}", f"as named: {seen}")
    return _beside(toml_line(one.key, one.source if len(rule) == 1 else rule), seen)


def _settings(look: Look, entries: Mapping[str, Sequence[str]]) -> Iterator[str]:
    if entries["thrusters"] or look.thrusters_drive:
        yield "[thrusters]"
    pulling = look.maps.given.defaults.get("thrusters_per_test")
    if entries["thrusters"] and pulling is not None:
        yield _beside(toml_line("per_test", int(pulling)), "equal thrusters that pulled together, as --columns says")
    elif entries["thrusters"]:
        yield _open("per_test", "how many equal thrusters pulled together? The logs cannot show it")
    if entries["thrusters"]:
        yield _beside(toml_line("form", "auto"), "thrust curve: auto chooses by cross-validation")
    if look.thrusters_drive and not entries["thrusters"]:
        yield _open("map", "a thrusters.json of this vehicle: there are no bollard tests to make one of")
    if entries["thrusters"] or look.thrusters_drive:
        yield ""
    yield "[yaw]"
    moment = "thrusters" if look.thrusters_drive else "logged"
    if look.misfit:
        yield from wrap(printable(look.misfit), WIDEST, initial_indent="# ", subsequent_indent="# ")
    both = "logged, or thrusters: made of n_port and n_stbd by a thruster map and vehicle.arm_m"
    yield _beside(toml_line("moment", moment), both)
    yield _beside(toml_line("fit_to", "auto"), "auto, half-turns or whole-runs")
