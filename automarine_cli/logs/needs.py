"""What a command cannot do without: `require` refuses a table that lacks it, and says how to name it."""

from collections.abc import Sequence, Set

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import (
    CANONICAL,
    COMMANDS,
    driven,
    likely_canonical,
    likely_column,
    motions_in,
    names_of,
    unit_in,
)
from automarine_cli.logs.table import LogTable
from automarine_cli.pipeline.words import listed, printable, quoted

_WORDS = {
    "n": "control signal",
    **{dof.command: dof.words.full_force for dof in DOFS.values()},
    **{name: f"{mount} thruster command" for dof in DOFS.values() for name, mount in zip(dof.thrusters, dof.mounts)},
}


def require(table: LogTable, quantities: Sequence[str]) -> None:
    """Refuse a table that lacks one of the quantities (names as in `LogTable.columns`).

    Raises LogError that lists the columns found and says what to write in the `--columns` file.
    """
    lacking = [quantity for quantity in quantities if quantity not in table.columns]
    if lacking:
        raise LogError(_sentence(table, lacking))


def require_motion(table: LogTable) -> None:
    """Refuse a table that is no log of its motion: time, position (or velocity, which can be summed up), and a moment
    or force or every thruster command."""
    dof = table.dof
    is_rate = is_velocity_only(table) or (
        _guess(table, dof.position) is None and _guess(table, dof.velocity) is not None
    )
    measured = dof.velocity if is_rate and dof.position not in table.columns else dof.position
    if is_commanded(table):
        require(table, ("time", measured))
    elif any(quantity in table.columns for quantity in dof.thrusters):
        require(table, ("time", measured, *dof.thrusters))
    else:
        require(table, ("time", measured, dof.command))


def is_commanded(table: LogTable) -> bool:
    """Whether the table holds what drives its motion: a moment or force, or every thruster command."""
    return table.dof.command in table.columns or driven(table.dof, table.columns.keys())


def is_velocity_only(table: LogTable) -> bool:
    """Whether the table holds the velocity of its motion but not the position."""
    return table.dof.position not in table.columns and table.dof.velocity in table.columns


def require_thruster(table: LogTable) -> None:
    """Refuse a table that is no thruster test: control signal and force."""
    require(table, ("n", "force"))


def is_thruster_test(table: LogTable) -> bool:
    """Whether the table is, or seems meant as, a thruster test rather than a log of a motion."""
    return means_thruster_test(table.columns.keys(), table.names, table.dof)


def means_thruster_test(held: Set[str], names: Sequence[str], dof: Dof) -> bool:
    """The same of a log of a motion that holds these quantities in columns of these names."""
    commanded = dof.command in held or driven(dof, held)
    if dof.position in held or (dof.velocity in held and commanded):
        return False
    free = [name for name in names if name and (name not in CANONICAL or name == "time")]
    return "force" in held or (likely_column("force", free) is not None and likely_column(dof.position, free) is None)


def _sentence(table: LogTable, lacking: Sequence[str]) -> str:
    what = _and([_WORDS.get(quantity, quantity.replace("_", " ")) for quantity in lacking])
    expected = "; ".join(_expected(quantity) for quantity in lacking)
    guesses = [(quantity, _guess(table, quantity)) for quantity in lacking]
    sure = [(quantity, guess) for quantity, guess in guesses if guess is not None]
    if sure:
        lines = " and ".join(_line(q, guess) for q, guess in sure)
        names = _and([quoted(guess) for _, guess in sure])
        hint = f"If {names} {'is' if len(sure) == 1 else 'are'} meant, write {lines}"
    else:
        hint = f'If it has another name, write a line such as {names_of(lacking[0])[0]} = "NAME"'
    if table.origin.why_not and set(lacking) & {dof.command for dof in DOFS.values()}:
        return f"{table.source}: no {what}; {table.origin.why_not}"
    unmet = [note for note in table.notes if any(f" for {n};" in note for q in lacking for n in names_of(q))]
    return (
        f"{table.source}: no {what}; found the columns {listed(table.names)}{_held(table)}; expected {expected}. "
        + "".join(f"{note[0].upper()}{note[1:]}. " for note in unmet)
        + (_meant_for(table, lacking) or f"{hint} under [columns] in a file and give it with --columns FILE.toml")
    )


def _line(quantity: str, column: str) -> str:
    """The line of a column map for a column; pulses to thrusters rest at 1500 us."""
    key, name = likely_canonical(quantity, column), printable(column)
    if quantity in COMMANDS and unit_in(column) == "us":
        return f'{key} = {{ from = "{name}", subtract = 1500 }}'
    return f'{key} = "{name}"'


def _meant_for(table: LogTable, lacking: Sequence[str]) -> str:
    """What the table is instead, and the command that reads it; empty where its columns make no whole log."""
    if set(lacking) == {"time"}:
        return ""

    held = {CANONICAL[name].quantity for name in table.names if name in CANONICAL}
    for dof in motions_in(held):
        return f"This is a log of {dof.name}: give it to automarine fit-{dof.name}"
    return "This is a thruster test: give it to automarine fit-thrusters" if held >= {"n", "force"} else ""


def _held(table: LogTable) -> str:
    """What else the file holds, of which a column map can name the fields."""
    return f" in a file that holds {listed(table.holds)}" if table.holds else ""


def _expected(quantity: str) -> str:
    names = " or ".join(names_of(quantity))
    thrusters = next((dof.thrusters for dof in DOFS.values() if dof.command == quantity), ())
    return f"{names} or {'both ' * (len(thrusters) > 1)}{' and '.join(thrusters)}" if thrusters else names


def _guess(table: LogTable, quantity: str) -> str | None:
    """The column that may be meant: none with a meaning already, except a `time` of plain numbers."""
    free = [name for name in table.names if name and (name not in CANONICAL or name == "time")]
    return likely_column(quantity, free)


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
