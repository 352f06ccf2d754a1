"""Recorded runs, played once more."""

import csv
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign, PlannedRun
from automarine_cli.link.vehicles.base import Halted, Pace


@dataclass(frozen=True)
class Replay:
    """Recorded runs, found in a folder by the names of the campaign's runs; their logs are played line by line."""

    folder: Path
    speed: float = 1.0

    def refuse(self, campaign: LinkCampaign) -> None:
        for run in campaign.runs:
            self._lines(run)

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        head, column, lines = self._lines(campaign.runs[number])
        if halted():
            return
        yield from head
        pace, first = Pace(self.speed), None
        for line in lines:
            now = float(next(csv.reader([line]))[column])
            if first is not None:
                pace.until(now - first)
                if halted():
                    return
            first = now if first is None else first
            yield line

    def _lines(self, run: PlannedRun) -> tuple[list[str], int, list[str]]:
        """Head of the recorded log, the place of its column time_s, and its rows."""
        logs = sorted(path for path in self.folder.glob("*.csv") if f"_{path.stem}".endswith(f"_{run.name}"))
        if len(logs) != 1:
            raise SettingError(
                f"{self.folder.name} holds {len(logs) or 'no'} logs of the run {run.name}; give a folder with one "
                f"NAME.csv for each run of the campaign"
            )
        lines = logs[0].read_text(encoding="utf-8").splitlines(keepends=True)
        first = next((i for i, line in enumerate(lines) if not line.startswith("#")), 0)
        columns = next(csv.reader(lines[first : first + 1]), [])
        if "time_s" not in columns:
            raise SettingError(f"{logs[0].name}: no column time_s, by which it would be played; name it so")
        return lines[: first + 1], columns.index("time_s"), lines[first + 1 :]
