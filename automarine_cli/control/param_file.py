"""Parameter files as ground stations write them: NAME,VALUE or NAME VALUE, one a line."""

import re
from collections.abc import Mapping

from automarine_cli.control.targets.base import Target
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import Source
from automarine_cli.pipeline.words import printable, quoted

LARGEST = 2_000_000  # bytes; a vehicle has some thousand parameters
LINE = re.compile(r"^\s*(?:\d+[\s,]+\d+[\s,]+)?([A-Z][A-Z0-9_]*)\s*[,\s]\s*(\S+)")


def present_gains(target: Target, source: Source | None) -> Mapping[str, float] | None:
    """What a target flies with now: its defaults with the values of a file; None where it has neither.

    Raises SettingError with the line for a value that is no number or lies outside the documented range.
    """
    if source is None:
        return target.defaults if target.has_defaults else None
    name = printable(source.name)
    if not target.has_defaults:
        raise SettingError(f"{target.name} reads no parameter file; leave out --present")
    own, found = {one.name: one for one in target.parameters}, target.defaults
    with source.open("rb") as file:
        text = file.read(LARGEST).decode("utf-8", "replace")
    seen = 0
    for row, line in enumerate(text.splitlines(), 1):
        match = LINE.match(line)
        if match is None or match[1] not in own:
            continue
        one, seen = own[match[1]], seen + 1
        try:
            value = float(match[2])
        except ValueError:
            raise SettingError(f"{name}, row {row}: {one.name} is {quoted(match[2])}; expected a number") from None
        if not (one.low <= value <= one.high or value == one.default):
            raise SettingError(
                f"{name}, row {row}: {one.name} is {value:g}, outside the range that {target.firmware} documents, "
                f"{one.low:g} to {one.high:g}; correct it on the vehicle first"
            )
        found[one.name] = value
    if not seen:
        raise SettingError(
            f"{name}: none of the parameters of {target.name} is in it; expected lines such as "
            f"{target.parameters[0].name},{target.parameters[0].default:g}"
        )
    return found
