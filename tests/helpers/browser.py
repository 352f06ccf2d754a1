"""Chromium without a window."""

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-background-networking",
    "--allow-file-access-from-files", "--enable-logging=stderr", "--dump-dom",
)  # fmt: skip


def looked_at(folder: Path, page: str, *flags: str, quiet: bool = True) -> Any:
    """What the script of a page in `folder` says once Chromium has loaded it; skipped where no browser is.

    A `quiet` page writes nothing to the console, not even that its own policy kept something out."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    (folder / "look.html").write_text(page, encoding="utf-8")
    command = [program, *FLAGS, *flags, f"--user-data-dir={folder / 'profile'}", str(folder / "look.html")]
    shown = subprocess.run(command, capture_output=True, encoding="utf-8", check=True, timeout=600)
    assert not quiet or "CONSOLE" not in shown.stderr
    return json.loads(unescape(re.sub("<[^>]*>", "", shown.stdout)))
