"""`serve`: on the vehicle, plays campaigns and hands out logs; or says beforehand what a campaign would be."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign, read_campaign
from automarine_cli.link.server import Serving, serve
from automarine_cli.link.vehicles.ardusub.ride import Limits
from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub
from automarine_cli.link.vehicles.base import Vehicle
from automarine_cli.link.vehicles.can import CanBus
from automarine_cli.link.vehicles.replay import Replay
from automarine_cli.link.vehicles.simulated import Simulated
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.planning.vehicle import drive_of
from automarine_cli.report.tables import Table
from automarine_cli.thrusters.moments import map_and_arm
from automarine_cli.workflows.command import UNRECORDED, Command, Runner, reads
from automarine_cli.workflows.view import View

SCHEMA = "automarine/rehearsal/1"


@dataclass(frozen=True)
class Rehearsed:
    """A run of a campaign: when its log begins, how long it is driven, how far the simulated vehicle turns [degrees]
    (None without a model), and what is left in the battery [Ah]."""

    name: str
    begins_s: float
    driven_s: float
    turned_deg: float | None
    left_Ah: float


@dataclass(frozen=True)
class Rehearsal:
    """What a campaign would be."""

    campaign: LinkCampaign
    runs: tuple[Rehearsed, ...]

    def to_json(self) -> dict[str, Any]:
        """Schema automarine/rehearsal/1."""
        return {"schema": SCHEMA, "campaign": self.campaign.id, "planned": [vars(run) for run in self.runs]}

    def tables(self) -> tuple[Table | str, ...]:
        """A line for each run, and the whole in a sentence."""
        rows = tuple(
            (run.name, f"{run.begins_s:.1f}", f"{run.driven_s:.1f}",
             "" if run.turned_deg is None else f"{run.turned_deg:+.0f}", f"{run.left_Ah:.3f}")
            for run in self.runs
        )  # fmt: skip
        last, battery = self.campaign.runs[-1], self.campaign.battery
        whole = self.campaign.begins(len(rows)) - last.wait_s
        left = 100.0 * self.runs[-1].left_Ah / battery.charge_Ah
        return (
            Table("Runs", ("run", "begins s", "driven s", "turns deg", "battery left Ah"), rows),
            f"{len(rows)} runs in {whole / 60.0:.1f} min; {left:.0f} % of the battery is left, "
            f"{battery.reserve_percent:g} % must be.",
        )


def _silent(news: Serving | str) -> None:
    """Nobody is told."""


@dataclass(frozen=True)
class ServeOptions:
    """The vehicle's folder and what drives: a simulated one with a `model`, `recordings` played once more, ArduSub at
    the address `mavlink`, or a CAN `bus` whose signals `columns` names.

    `full` is the moment of ArduSub's whole output, or `thrusters` at an `arm` [m] tell it, as they make the commands
    of a CAN bus; it is also the largest that a simulated vehicle takes (None: what its model was fitted to, and 1 nu).
    `depth_limit` [m] and `heading_limit` [deg] end a run of ArduSub. `speed` is how many times as fast as the clock;
    with `dry_run` a `campaign` is only looked at, and simulated where there is a `model`; `tell` hears the address and
    the token, then sentences on what comes about.
    """

    folder: Path
    vehicle: Literal["simulated", "replay", "ardusub", "can"] = "simulated"
    model: Path | None = field(default=None, metadata=reads("file"))
    recordings: Path | None = None
    mavlink: str | None = None
    bus: str | None = None
    columns: Path | ColumnMap | None = field(default=None, metadata=reads("file"))
    full: float | None = None
    thrusters: Path | None = field(default=None, metadata=reads("file"))
    arm: float | None = None
    depth_limit: float = math.inf
    heading_limit: float = 1080.0
    address: str = "127.0.0.1:8722"
    speed: float = 1.0
    dry_run: bool = False
    campaign: Path | None = None
    tell: Callable[[Serving | str], object] = field(default=_silent, metadata=UNRECORDED)


def _serve(asked: ServeOptions, runner: Runner) -> Rehearsal:
    """Serve `folder` until interrupted; with `dry_run` say what a campaign would be.

    Raises SettingError for a campaign that the battery does not carry or the vehicle cannot drive, and ModelError.
    """
    vehicle = _vehicle(asked)
    if not asked.dry_run:
        serve(Path(asked.folder), vehicle, _address(asked.address), asked.speed, asked.tell)
    if asked.campaign is None:
        raise SettingError("a dry run looks at a campaign; give one with --campaign")
    campaign = read_campaign(Path(asked.campaign))
    vehicle.refuse(campaign)
    campaign.refuse_beyond_reserve()
    if isinstance(vehicle, ArduSub):
        vehicle.look(campaign)
    runs, on_paper = [], None if asked.model is None else Simulated.of(asked.model, asked.speed, _limit(asked))
    if on_paper is not None:
        on_paper.refuse(campaign)
    for number, run in enumerate(campaign.runs):
        turned = None
        if on_paper is not None:
            heading = on_paper.track(campaign, run).heading
            turned = float(np.rad2deg(heading[-1] - heading[0]))
        runs.append(Rehearsed(run.name, campaign.begins(number), run.driven, turned, campaign.left(number + 1)))
        runner.progress("simulating", number + 1, len(campaign.runs))
    return Rehearsal(campaign, tuple(runs))


def _limit(asked: ServeOptions) -> float | None:
    """The largest moment of what is simulated; another vehicle has looked at its own."""
    return asked.full if asked.vehicle == "simulated" else math.inf


def _vehicle(asked: ServeOptions) -> Vehicle:
    if asked.vehicle == "simulated":
        if asked.model is None:
            raise SettingError("a simulated vehicle has the dynamics of a model; give one with --model")
        return Simulated.of(asked.model, asked.speed, asked.full)
    if asked.vehicle in ("ardusub", "can") and asked.speed != 1.0:
        raise SettingError("a vehicle in the water goes by the clock; leave out --speed")
    if asked.vehicle == "ardusub":
        if asked.mavlink is None:
            raise SettingError("where the autopilot is was not said; give its address with --mavlink")
        limits = Limits(asked.depth_limit, asked.heading_limit)
        return ArduSub(asked.mavlink, asked.full, asked.thrusters, asked.arm, limits)
    if asked.vehicle == "can":
        if asked.bus is None:
            raise SettingError("where the bus is was not said; give it with --bus")
        names = given_columns(asked.columns)
        made = map_and_arm(asked.thrusters, asked.arm, names, YAW)
        drive = None if made is None else drive_of(*made, most=None, equal_thrust=True, unit=1.0)
        return CanBus(asked.bus, names, drive)
    if asked.recordings is None:
        raise SettingError("what is to be replayed was not said; give the folder of logs with --recordings")
    return Replay(Path(asked.recordings), asked.speed)


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif ":" in host:
        host = ""
    if not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise SettingError(f"found the address {text!r}, expected HOST:PORT, such as 0.0.0.0:8722 or [::1]:8722")
    return host, int(port)


serve_runs = Command(
    "serve", ServeOptions, _serve, {Rehearsal: View(Rehearsal.tables, lambda result: iter(()))}
)  # fmt: skip
