"""`automarine run`: a recorded recipe in, one workflow call, whether the bytes are the same out."""

from pathlib import Path

import click

from automarine_cli.cli import options


@click.command("run", short_help="Make a recorded result again.")
@click.option(
    "--from", "recorded", required=True, type=click.Path(exists=True, path_type=Path), metavar="MANIFEST",
    help="The manifest.json of a result, or the folder that holds it.",
)  # fmt: skip
@options.inputs_option
@options.out_option
@options.overwrite_option
@options.jobs_option
@options.json_option
@options.verbosity
@click.pass_context
def run(
    ctx: click.Context, recorded: Path, inputs: tuple[Path, ...], out: Path | None, overwrite: bool, jobs: int,
    as_json: bool,
) -> object:  # fmt: skip
    """Make a result again from its manifest: the same command, options and inputs.

    Inputs are found by name and content under the folders given with --inputs (by default here); one that is
    missing or has changed is refused. Then it is said whether every file has the bytes recorded, and which
    versions differ. Exit status 0 if all bytes are the same, else 1.

    \b
    Example:
      automarine run --from out/fit-yaw/manifest.json -o out/again
    """
    from automarine_cli.workflows import rerun as workflow

    result = workflow.rerun(
        recorded,
        inputs=inputs,
        out=out,
        overwrite=overwrite,
        jobs=jobs,
        progress=options.terminal_progress(),
    )
    options.echo_result(result, as_json=as_json, out=out, tables=result.sentences())
    if not result.same:
        ctx.exit(1)
    return result
