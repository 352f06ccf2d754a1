"""Few words for many logs: folders where all logs in them are meant, else globs, else the files themselves."""

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase

from automarine_cli.logs.formats import stem_of


def places_of(wanted: Sequence[str], everywhere: Sequence[str]) -> list[str]:
    """Folders, globs and files (relative, with forward slashes) that mean exactly `wanted` of all logs.

    The folder at the top is never one of them: results that are written into it later would be taken for logs.
    """
    left, found = set(wanted), []
    for folder in _folders(everywhere):
        inside = {name for name in everywhere if name.startswith(f"{folder}/")}
        if inside and inside <= left:
            found.append(folder)
            left -= inside
    for glob in _globs(sorted(left)):
        meant = {name for name in everywhere if _matches(name, glob)}
        if len(meant & left) > 1 and meant <= set(wanted):
            found.append(glob)
            left -= meant
    return sorted([*found, *left])


def _folders(names: Sequence[str]) -> list[str]:
    """Folders that hold logs at any depth, outer ones first."""
    found = {"/".join(name.split("/")[:i]) for name in names for i in range(1, name.count("/") + 1)}
    return sorted((one for one in found if not re.search(r"[*?[]", one)), key=lambda one: (one.count("/"), one))


def _globs(names: Sequence[str]) -> list[str]:
    """Globs by ending and by the first word of a name, the wider ones first."""
    wide, narrow = [], []
    for name in names:
        folder, slash, last = name.rpartition("/")
        stem, ending = stem_of(last), last[len(stem_of(last)) :]
        if re.search(r"[*?[]", name):
            continue
        wide.append(f"{folder}{slash}*{ending}")
        word = re.match(r"[A-Za-z]+[_-]?|\d+", stem)
        if word and word[0] != stem:
            narrow += [f"{folder}{slash}{word[0]}*", f"{folder}{slash}{word[0]}*{ending}"]
    return list(dict.fromkeys([*wide, *narrow]))


def _matches(name: str, glob: str) -> bool:
    """Whether a glob means a name; a star stays within its folder."""
    return name.rpartition("/")[0] == glob.rpartition("/")[0] and fnmatchcase(name, glob)
