"""`serve`: on the vehicle, plays campaigns and hands out logs; or says beforehand what a campaign would be."""

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import argument, command, option
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.parallel import Progress

if TYPE_CHECKING:
    from automarine_cli.link.vehicles.base import Vehicle
    from automarine_cli.link.vehicles.simulated import Rehearsal

ABOVE_ZERO = click.FloatRange(min=0, min_open=True)
VEHICLES = {"simulated": "model", "replay": "recordings", "ardusub": "mavlink", "can": "bus"}
"""The option that each vehicle needs."""


@command("serve", report="link_report", then="automarine collect URL --campaign {campaign} -o DIR", saves=False)
@argument("folder", metavar="DIR", type=click.Path(file_okay=False, path_type=Path))
@option(
    "--vehicle", "kind", type=click.Choice(tuple(VEHICLES)), required=True,
    help="What to drive: a simulated vehicle, earlier logs played again, ArduSub over MAVLink, or a CAN bus.",
)  # fmt: skip
@option(
    "--model", type=options.FILE, metavar="FILE", help="The yaw_model.json of the simulated vehicle, or of a --dry-run."
)
@option(
    "--recordings", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR",
    help="The logs to play again: NAME.csv for each run of the campaign.",
)  # fmt: skip
@option(
    "--mavlink", metavar="ADDRESS",
    help="Address of ArduSub: udpin:0.0.0.0:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD.",
)  # fmt: skip
@option("--bus", metavar="INTERFACE:CHANNEL", help="The CAN bus, as python-can names it: socketcan:can0.")
@options.columns
@option(
    "--full", type=ABOVE_ZERO, metavar="MOMENT",
    help="Largest moment of ArduSub or the simulated vehicle, in the plan's unit.",
)  # fmt: skip
@options.thrusters
@options.arm
@option("--depth-limit", type=ABOVE_ZERO, default=math.inf, metavar="METRES", help="Stop ArduSub below this depth.")
@option(
    "--heading-limit", type=ABOVE_ZERO, default=1080.0, show_default=True, metavar="DEGREES",
    help="Stop ArduSub if a run turns it further to one side.",
)  # fmt: skip
@option(
    "--address", default="127.0.0.1:8722", show_default=True, metavar="HOST:PORT",
    help="Where to listen: 0.0.0.0:8722 for every network, [::]:8722 for IPv6 too.",
)  # fmt: skip
@option(
    "--speed", type=click.FloatRange(min=0, min_open=True, max=1000), default=1.0, show_default=True, metavar="N",
    help="Play N times as fast as the clock (simulated and replay only).",
)  # fmt: skip
@option("--dry-run", is_flag=True, help="Check a campaign and the vehicle, and move nothing.")
@option(
    "--campaign", type=click.Path(exists=True, path_type=Path), metavar="PLAN",
    help="With --dry-run: the folder of a plan, or its plan.json.",
)  # fmt: skip
@options.as_json
@options.verbosity
def serve(
    *, folder: Path, campaign: Path | None, dry_run: bool, address: str, progress: Progress, **settings: Any
) -> "Rehearsal":
    """Drive campaigns on a vehicle, keep their logs in DIR, and serve them over HTTP, until Ctrl-C.

    It prints its address and a token, which `automarine collect` needs. A separate process drives. It stops the
    vehicle when the server is gone. After a power cut, a new start continues with the next run.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine plan out/yaw/yaw_model.json -o out/plan
      automarine serve out/vehicle --vehicle simulated \\
        --model out/yaw/yaw_model.json --dry-run --campaign out/plan
    """
    from automarine_cli.link import server
    from automarine_cli.link.document import read_campaign
    from automarine_cli.link.vehicles.simulated import Simulated, rehearse

    vehicle, speed = _vehicle(**settings), settings["speed"]
    if not dry_run:
        server.serve(folder, vehicle, _host_and_port(address), speed, _tell)
    assert campaign is not None
    planned = read_campaign(campaign)
    vehicle.refuse(planned)
    planned.refuse_beyond_reserve()
    if settings["kind"] == "ardusub":
        vehicle.look(planned)  # type: ignore[attr-defined]
    # another vehicle than the simulated one has looked at the largest moment itself
    full = settings["full"] if settings["kind"] == "simulated" else math.inf
    on_paper = None if settings["model"] is None else Simulated.of(settings["model"], speed, full)
    return rehearse(planned, on_paper, progress)


def _refuse_halves(settings: dict[str, Any]) -> dict[str, Any]:
    if bool(settings["campaign"]) != settings["dry_run"]:
        raise click.UsageError("--dry-run and --campaign go together; a campaign is handed over by automarine collect")
    kind = settings["kind"]
    if settings[VEHICLES[kind]] is None:
        raise click.UsageError(f"--vehicle {kind} needs --{VEHICLES[kind]}; give it.")
    return settings


serve.complete = _refuse_halves


def _vehicle(
    *, kind: str, model: Any, recordings: Any, mavlink: Any, bus: Any, columns: Any, full: float | None, thrusters: Any,
    arm: float | None, depth_limit: float, heading_limit: float, speed: float,
) -> "Vehicle":  # fmt: skip
    if kind == "simulated":
        from automarine_cli.link.vehicles.simulated import Simulated

        return Simulated.of(model, speed, full)
    if kind == "replay":
        from automarine_cli.link.vehicles.replay import Replay

        return Replay(recordings, speed)
    if speed != 1.0:
        raise SettingError("a vehicle in the water goes by the clock; leave out --speed")
    if kind == "ardusub":
        from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub, ArduSubLimits

        return ArduSub(mavlink, full, thrusters, arm, ArduSubLimits(depth_limit, heading_limit))
    from automarine_cli.link.vehicles.can import CanBus

    return CanBus.of(bus, columns, thrusters, arm)


def _host_and_port(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif ":" in host:
        host = ""
    if not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise SettingError(f"found the address {text!r}, expected HOST:PORT, such as 0.0.0.0:8722 or [::1]:8722")
    return host, int(port)


def _tell(news: str, token: str = "") -> None:
    """Print the address and the token, then sentences on what comes about."""
    if token:
        click.echo(f"{news}\ntoken: {token}")
        sys.stdout.flush()
    else:
        click.echo(news, err=True)
