"""One log to be read: a file, or a table that is none."""

from dataclasses import dataclass, field
from pathlib import Path

from automarine_cli.pipeline.records import Document, Source


@dataclass(frozen=True)
class LogFile:
    """One log: where it is, what results call it (never depends on the working directory), and whether it was
    named on the command line itself (then unreadable means refused) or found (then it is set aside). A table that is
    no file has its `content`, as a Parquet file would."""

    path: Path
    name: str
    named: bool
    content: bytes | None = field(default=None, repr=False)

    @property
    def source(self) -> Source:
        """What its bytes are read from."""
        return self.path if self.content is None else Document(self.name, self.content)
