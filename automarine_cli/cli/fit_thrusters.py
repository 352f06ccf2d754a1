"""`automarine fit-thrusters`: options in, one workflow call, tables out."""

from pathlib import Path

import click

from automarine_cli.cli import options

FORM_NAMES = ("square", "dead-band", "power", "dead-band-power")
FORMS = (*FORM_NAMES, *(f"{name}-saturation" for name in FORM_NAMES))


@click.command("fit-thrusters", short_help="Bollard tests to a thruster map.")
@options.logs_argument
@options.columns_option
@click.option(
    "--thrusters-per-test",
    type=click.IntRange(min=1),
    metavar="N",
    help="Equal thrusters that pulled together.  [default: the --columns file's, else 1]",
)
@click.option(
    "--form",
    type=click.Choice(("auto", *FORMS)),
    default="auto",
    show_default=True,
    metavar="FORM",
    help=f"Thrust curve of the map: {', '.join(FORMS)}; or auto, which chooses by cross-validation.",
)
@options.out_option
@options.overwrite_option
@options.strict_option
@options.jobs_option
@options.json_option
@options.verbosity
def fit_thrusters(
    logs: tuple[str, ...],
    columns: Path | None,
    thrusters_per_test: int | None,
    form: str,
    out: Path | None,
    overwrite: bool,
    strict: bool,
    jobs: int,
    as_json: bool,
) -> object:
    """Bollard tests (columns n, force_N) into the map of one thruster, forward and backward apart.

    The square law F = a |n| n is fitted always; seven other curves stand beside it, and cross-validation
    chooses. Raw load-cell series are reduced to plateaus, a voltage column gives a map for each voltage.

    \b
    Example:
      automarine fit-thrusters sample_runs/thrusters --thrusters-per-test 2
    """
    from automarine_cli.report.thruster_tables import sentences, tables
    from automarine_cli.workflows import fit_thrusters as workflow

    result = workflow.fit_thrusters(
        logs,
        columns=columns,
        out=out,
        overwrite=overwrite,
        strict=strict,
        thrusters_per_test=thrusters_per_test,
        form=None if form == "auto" else form,
        jobs=jobs,
        progress=options.terminal_progress(),
    )
    options.echo_result(
        result, as_json=as_json, out=out, tables=(*tables(result), *sentences(result)), files=workflow.FILES
    )
    return result
