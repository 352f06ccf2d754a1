"""`automarine serve`: a vehicle's folder in, one workflow call, an address out."""

import sys
from math import inf
from pathlib import Path
from typing import Any

import click

from automarine_cli.cli import options

POSITIVE = click.FloatRange(min=0, min_open=True)


def _tell(news: Any) -> None:
    if isinstance(news, str):
        click.echo(news, err=True)
    else:
        click.echo(f"{news.url}\ntoken: {news.token}")
        sys.stdout.flush()


@click.command("serve", short_help="On the vehicle: play campaigns, hand out logs.")
@click.argument("folder", metavar="DIR", type=click.Path(file_okay=False, path_type=Path))
@click.option(
    "--vehicle", type=click.Choice(("simulated", "replay", "ardusub", "can")), required=True,
    help="What drives: a simulated vehicle, logs that are played once more, ArduSub over MAVLink, or a CAN bus.",
)  # fmt: skip
@click.option(
    "--model", type=options.FILE, metavar="FILE", help="The yaw_model.json of the simulated vehicle, or of a --dry-run."
)
@click.option(
    "--recordings", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR",
    help="The logs that are replayed, NAME.csv for each run of the campaign.",
)  # fmt: skip
@click.option(
    "--mavlink", metavar="ADDRESS",
    help="Of ArduSub: udpin:0.0.0.0:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD.",
)  # fmt: skip
@click.option("--bus", metavar="INTERFACE:CHANNEL", help="The CAN bus, as python-can names it: socketcan:can0.")
@options.columns_option
@click.option(
    "--full",
    type=POSITIVE,
    metavar="MOMENT",
    help="Largest moment of ArduSub or the simulated vehicle, in the plan's unit.",
)
@options.thrusters_option
@options.arm_option
@click.option("--depth-limit", type=POSITIVE, default=inf, metavar="METRES", help="Stop ArduSub where it is deeper.")
@click.option(
    "--heading-limit", type=POSITIVE, default=1080.0, show_default=True, metavar="DEG",
    help="Stop ArduSub where a run turns it further to one side.",
)  # fmt: skip
@click.option(
    "--address", default="127.0.0.1:8722", show_default=True, metavar="HOST:PORT",
    help="Where to listen; 0.0.0.0:8722 for every network, [::1]:8722 in IPv6.",
)  # fmt: skip
@click.option(
    "--speed", type=click.FloatRange(min=0, min_open=True, max=1000), default=1.0, show_default=True, metavar="N",
    help="Play so many times as fast as the clock.",
)  # fmt: skip
@click.option("--dry-run", is_flag=True, help="Look at a campaign, simulate it, and play nothing.")
@click.option(
    "--campaign", type=click.Path(exists=True, path_type=Path), metavar="FILE",
    help="With --dry-run: the folder of a plan, or its plan.json.",
)  # fmt: skip
@options.json_option
@options.verbosity
def serve(**given: Any) -> object:
    """Play campaigns on a vehicle, keep their logs in DIR, and hand them out over HTTP, until Ctrl-C.

    It prints its address and a token, which `automarine collect` needs. A process of its own drives: after a power
    cut it goes on with the next run, and it stops when the server is gone.

    \b
    Example:
      automarine serve out/vehicle --vehicle simulated --model out/yaw/yaw_model.json --dry-run --campaign out/plan
    """
    if bool(given["campaign"]) != given["dry_run"]:
        raise click.UsageError("--dry-run and --campaign go together; a campaign is handed over by automarine collect")
    needed = {"simulated": "model", "replay": "recordings", "ardusub": "mavlink", "can": "bus"}[given["vehicle"]]
    if given[needed] is None:
        raise click.UsageError(f"--vehicle {given['vehicle']} needs --{needed}; give it.")
    from automarine_cli.workflows.serve import serve_runs

    return options.perform_one(serve_runs, {**given, "tell": _tell})
