"""Where the repository and the real data stand."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SAMPLE_RUNS = ROOT / "sample_runs"
DATA = Path(os.environ.get("AUTOMARINE_DATA", ROOT.parent / "shared" / "data"))
