"""Files that are one log: a navigation file and a command file of one run, told by their names."""

import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

from automarine_cli.errors import LogError, SettingError
from automarine_cli.pipeline.words import printable

OLDEST = 5.0  # s; a command older than this is none


@dataclass(frozen=True)
class Join:
    """Each of `logs` (a name or the end of a path) is one log `with_` the files whose names have the same letters where
    its stars are.

    Their columns come onto the clock of the log: the previous value is held until the next, or the nearest is taken;
    none is older (or further) than `max_age_s` [s].
    """

    logs: str
    with_: str | tuple[str, ...]
    take: Literal["previous", "nearest"] = "previous"
    max_age_s: float = OLDEST

    def __post_init__(self) -> None:
        stars = self.logs.count("*")
        for other in self.others:
            if other.count("*") not in (0, stars) or not other or not self.logs:
                raise SettingError(
                    f'join of "{self.logs}" with "{other}": expected as many stars in both, or none in the second; a '
                    "star stands for the same letters in both names"
                )
        if not self.max_age_s > 0:
            raise SettingError(f"max_age_s is {self.max_age_s:g}; expected seconds above 0")

    @property
    def others(self) -> tuple[str, ...]:
        """The patterns of the files that are joined."""
        return (self.with_,) if isinstance(self.with_, str) else self.with_

    def beside(self, path: Path) -> tuple[Path, ...]:
        """The files joined to the log at `path`, none where it is not of those meant. Raises LogError for one that is
        not there."""
        depth = len(PurePosixPath(self.logs).parts)
        found = re.fullmatch(_with_stars(self.logs), "/".join(path.absolute().parts[-depth:]))
        if found is None:
            return ()
        names = [_filled(other, found.groups()) for other in self.others]
        base = path.parents[depth - 1] if depth <= len(path.parents) else path.absolute().parents[depth - 1]
        lost = next((name for name in names if not (base / name).is_file()), None)
        if lost is not None:
            raise LogError(
                f"{printable(path.name)}: no {printable(lost)} beside it, which join expects; copy it there, or "
                "correct the names in join"
            )
        return tuple(base / name for name in names)


def matches(path: Path, pattern: str) -> bool:
    """Whether a pattern means a log: its name, the end of its path, or that of a folder it is in."""
    whole = PurePosixPath(path.absolute().as_posix())
    return any(one.match(pattern) for one in (whole, *whole.parents))


def _with_stars(pattern: str) -> str:
    """The regular expression of a pattern in which each star is a group."""
    return "([^/]*)".join(re.escape(part) for part in pattern.split("*"))


def _filled(pattern: str, letters: tuple[str, ...]) -> str:
    stars = iter(letters)
    return re.sub(r"\*", lambda _: next(stars), pattern)
