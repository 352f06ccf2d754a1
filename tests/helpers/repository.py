"""Where the repository and the real data stand, and what stands in a folder."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SAMPLE_RUNS = ROOT / "sample_runs"
DATA = Path(os.environ.get("AUTOMARINE_DATA", ROOT.parent / "shared" / "data"))


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder by its relative name."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
