"""automarine by its command line."""

import json
import tempfile
from pathlib import Path

from automarine_cli.commands import automarine

TITLE, PACKAGE = "automarine", "automarine"
GIVEN = "`automarine fit-yaw LOGS -o OUT`, with its defaults."
LINES = 1


def fit(folder: Path) -> dict[str, list[float]]:
    """Inertia and drag of model 3, each with its 95 % interval."""
    with tempfile.TemporaryDirectory() as out:
        automarine(["fit-yaw", str(folder), "-o", out, "--figures", "none", "-qq"], standalone_mode=False)
        stored = json.loads(Path(out, "yaw_model.json").read_text())["models"]["3"]
    found = stored.get("output_error", stored)
    return {name: [found[name]["value"], *found[name]["ci95"]] for name in ("I_r", "k_rr")}
