"""`fit-planar`: logs of motion in the plane -> surge, sway and yaw together, with what couples them."""

from collections.abc import Sequence
from pathlib import Path

from automarine_cli.fits.planar_fit import Estimator, PlanarFit, search
from automarine_cli.fits.planar_structure import observed
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.models.thruster_map import ThrusterMap
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.report import planar_report
from automarine_cli.workflows.planar_runs import load_planar


def fit_planar(
    logs: Sequence[str | Path],
    *,
    estimate: Estimator,
    columns: Path | ColumnMap | None = None,
    thrusters: Path | ThrusterMap | None = None,
    arm: float | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    strict: bool = False,
    jobs: int = 1,
    progress: Progress = silent,
) -> PlanarFit:
    """Identify surge, sway and yaw together, and what couples them; writes the results if `out` is given.

    `thrusters` and `arm` [m] turn the commands of two thrusters into force and moment. What the logs do not hold is
    tied to assumptions that the result names. Raises LogError, RunError, FitError, SettingError or OutputError.
    """
    names = given_columns(columns)
    campaign = load_planar(logs, names, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
    seen = observed(campaign.runs)

    def work() -> PlanarFit:
        return PlanarFit(search(campaign.runs, seen, estimate), campaign.runs, seen, campaign.set_aside)

    if out is None:
        return work()
    inputs = [Input(file.name, file.path) for file in campaign.inputs]
    inputs += given_as(columns=columns, dbc=names.database, thrusters=thrusters)
    options = {"columns": columns, "thrusters": thrusters, "arm": arm, "strict": strict}
    with result_folder(
        out, command="fit-planar", options=options, inputs=inputs, seed=None, overwrite=overwrite
    ) as folder:
        fit = work()
        folder.write_json("planar_model.json", fit.to_json())
        tables = planar_report.tables(fit)
        folder.write("planar.csv", tables[0].to_csv())
        sentences = "\n".join(f"{one}\n" for one in planar_report.sentences(fit))
        folder.write("planar.md", "\n".join([*(one.to_markdown() for one in tables), sentences]))
        folder.write("planar.tex", "\n".join(one.to_latex() for one in tables))
    return fit
