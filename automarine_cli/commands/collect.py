"""`collect`: on the surface, hands a campaign to the vehicle and fetches its logs, over any link that is cut; then, if
it is asked to, has them analysed."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import OUTPUT, argument, command, option
from automarine_cli.commands.terminal import end_with
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.parallel import Progress

if TYPE_CHECKING:
    from automarine_cli.link.collector import Collected

ANALYSIS = "analysis"
"""Where in the folder of logs the results are."""


@command("collect", report="link_report", saves=False)
@argument("url", metavar="URL")
@option(
    "-o", "--out", type=click.Path(file_okay=False, path_type=Path), metavar="DIR", required=True, group=OUTPUT,
    help="Fetch the logs into this folder.",
)  # fmt: skip
@option(
    "--token", default="", envvar="AUTOMARINE_TOKEN", show_envvar=True, metavar="TOKEN",
    help="The token that serve printed.",
)  # fmt: skip
@option("--token-file", type=options.FILE, metavar="FILE", help="Read it from a file: all can see a command line.")
@option(
    "--campaign", type=click.Path(exists=True, path_type=Path), metavar="PLAN",
    help="Send the folder of a plan, or its plan.json, and wait until it is over.",
)  # fmt: skip
@option("--stop", is_flag=True, help="On contact, first stop the vehicle's campaigns for good.")
@option(
    "--wait", type=click.FloatRange(min=0), metavar="SECONDS",
    help="Give up after this time without contact.  [default: never]",
)  # fmt: skip
@option(
    "--then", type=click.Choice(("run",)),
    help="When the campaigns are over, run the campaign.toml in DIR (made as by init) into DIR/analysis.",
)  # fmt: skip
@option("--overwrite", is_flag=True, group=OUTPUT, help="Fetch again the logs that were changed in DIR.")
@options.jobs
@options.as_json
@options.verbosity
def collect(
    url: str, token: str, token_file: Path | None, campaign: Path | None, stop: bool, wait: float | None,
    then: str | None, out: Path, overwrite: bool, jobs: int, progress: Progress,
) -> "Collected":  # fmt: skip
    """Wait for contact with a vehicle that runs `automarine serve` at URL, and fetch its logs into DIR.

    On contact, --stop comes first, then the campaign, then the logs. After a break it continues where it was. Logs
    have the same names and bytes as on the vehicle, and ledger.json has their SHA-256. The exit status is 1 if the
    campaign ended before its last run.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine plan out/yaw/yaw_model.json -o out/plan
      automarine collect http://192.168.2.2:8722 --token TOKEN \\
        --campaign out/plan -o out/pool --then run
    """
    from automarine_cli.link.collector import Client, Collector
    from automarine_cli.link.document import read_campaign

    if token_file is not None and not (token := token_file.read_text(encoding="utf-8", errors="replace").strip()):
        raise SettingError(f"{token_file} holds no token; write the one that serve printed into it")
    planned = None if campaign is None else read_campaign(campaign)
    if planned is not None:
        planned.refuse_beyond_reserve()
    result = Collector(Client.of(url, token), out, wait, progress, overwrite).collected(planned, stop)
    if then is None:
        return result
    if result.waits_for:
        return replace(result, no_analysis=f"No analysis was started: {result.waits_for}.")
    return replace(result, analysis=_analysed(out, result.logs, overwrite, jobs, progress))


def _analysed(folder: Path, logs: Iterable[str], overwrite: bool, jobs: int, progress: Progress) -> Any:
    """What `run` makes of the logs. Raises SettingError for a campaign file that leaves some of them out."""
    from automarine_cli.commands.campaign import read_campaign
    from automarine_cli.commands.init import CAMPAIGN_FILE, init
    from automarine_cli.commands.run import run_campaign

    file = folder / CAMPAIGN_FILE
    if not file.exists():
        init(folder, out=file, jobs=jobs, progress=progress)
    if left_out := sorted(set(logs) - {log.path.name for log in read_campaign(file).every_log()}):
        raise SettingError(
            f"{CAMPAIGN_FILE} in {folder} leaves out {len(left_out)} of {len(set(logs))} logs, such as {left_out[0]}; "
            "add them, or move the file away, and it is written anew"
        )
    return run_campaign(file, out=folder / ANALYSIS, overwrite=overwrite, jobs=jobs, progress=progress)


def _finish(ctx: click.Context, result: "Collected") -> None:
    if result.analysis is not None:
        end_with(ctx, list(result.analysis.refused))
    errors = [*result.damaged, *filter(None, [result.ended_early])]
    for error in errors:
        click.echo(f"Error: {error}", err=True)
    if errors:
        ctx.exit(1)


def _then(result: "Collected") -> str:
    if result.analysis is not None:
        return "open {out}/analysis/report.html"
    return "automarine init {out}" if result.logs else ""


collect.finish, collect.then = _finish, _then
