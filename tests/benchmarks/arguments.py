"""What every script here begins and ends with: its options, one core a process, results as JSON.

Imported before numpy, whose threads it limits: its name sorts first.
"""

import argparse
import json
import os
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"


def options(usage: str | None, positional: dict[str, dict[str, Any]] | None = None, **flags: Any) -> argparse.Namespace:
    """Read the command line; a flag comes with its default, of whose type it is, or with what argparse takes."""
    parser = argparse.ArgumentParser(description=usage, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, more in (positional or {}).items():
        parser.add_argument(name, **more)
    for name, value in flags.items():
        typed = {"action": "store_true"} if value is False else {"type": type(value), "default": value}
        parser.add_argument(f"--{name}", **(value if isinstance(value, dict) else typed))
    return parser.parse_args()


def write_json(path: Path, content: object) -> None:
    """Write the file anew, in a folder that may be missing; whoever reads meets the old one or the new one whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=1, default=float) + "\n", encoding="utf-8")
    part.replace(path)
