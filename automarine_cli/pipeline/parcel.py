"""Files that travel to another machine and back: their bytes, and where they stood to each other."""

import contextlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from automarine_cli.pipeline import staging


@dataclass(frozen=True)
class Parcel:
    """Bytes by absolute place without the root, in forward slashes; None for a link that leads nowhere."""

    files: Mapping[str, bytes | None]

    def unpack(self, folder: Path) -> None:
        """Put everything under `folder`, as if that were the root. Raises OSError."""
        for place, data in self.files.items():
            file = folder / place
            file.parent.mkdir(parents=True, exist_ok=True)
            if data is None:
                file.symlink_to("nowhere")
            else:
                file.write_bytes(data)


def without_dots(path: Path) -> Path:
    """The absolute path with links as they are: a name must not become that of what it leads to."""
    return Path(os.path.abspath(path))  # noqa: PTH100


def place_of(path: Path) -> str:
    """Where a file stands in a parcel."""
    whole = without_dots(path)
    return whole.relative_to(whole.anchor).as_posix()


def packed(paths: Iterable[Path]) -> Parcel:
    """The files as they are now. Raises OSError for one that cannot be read, but for a link that leads nowhere."""
    return Parcel({place_of(path): path.read_bytes() if path.exists() else None for path in paths})


def content_of(folder: Path) -> dict[str, bytes]:
    """Bytes of all files in a folder, by relative name; empty where there is no folder."""
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def install(content: Mapping[str, bytes], out: Path) -> None:
    """Make `out` a folder of just this content, at once. Raises OutputError."""
    target = Path(os.path.realpath(out))
    with staging.one_sentence(out), staging.staged(target) as stage:
        for name, data in content.items():
            file = stage / name
            file.parent.mkdir(parents=True, exist_ok=True)
            staging.write(file, data, through=False)
        with contextlib.suppress(FileNotFoundError):
            stage.chmod(target.stat().st_mode & 0o777)
        staging.put_in_place(stage, target, through=False)
