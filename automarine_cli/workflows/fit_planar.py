"""`fit-planar`: logs of motion in the plane -> surge, sway and yaw together, with what couples them."""

from collections.abc import Callable, Sequence
from pathlib import Path

from automarine_cli.fits.planar_fit import Estimator, PlanarFit, search
from automarine_cli.fits.planar_likelihood import PlanarLikelihood
from automarine_cli.fits.planar_structure import Observed, observed
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.report import planar_report
from automarine_cli.report.figures.files import refuse_unknown, write_figures
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.workflows.planar_runs import load_planar


def fit_planar(
    logs: Sequence[str | Path],
    *,
    columns: Path | ColumnMap | None = None,
    thrusters: Path | ThrusterMap | None = None,
    arm: float | None = None,
    out: Path | None = None,
    figure_formats: tuple[str, ...] = ("png",),
    overwrite: bool = False,
    strict: bool = False,
    jobs: int = 1,
    progress: Progress = silent,
    estimating: Callable[[tuple[Run, ...], Observed], Estimator] = PlanarLikelihood,
) -> PlanarFit:
    """Identify surge, sway and yaw together, and what couples them; writes the results if `out` is given.

    `thrusters` and `arm` [m] turn the commands of two thrusters into force and moment. What the logs do not hold is
    tied to assumptions that the result names. `estimating` makes what fits a structure.

    Raises LogError, RunError, FitError, SettingError or OutputError.
    """
    refuse_unknown(figure_formats)
    names = given_columns(columns)
    campaign = load_planar(logs, names, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
    seen = observed(campaign.runs)

    def work() -> PlanarFit:
        estimator = estimating(campaign.runs, seen)
        tried = search(campaign.runs, seen, estimator)
        use, limits = estimator.use(tried[0].found), tuple(one.warning for one in campaign.limits)
        return PlanarFit(tried, campaign.runs, seen, campaign.set_aside, use, limits)

    if out is None:
        return work()
    inputs = [Input(file.name, file.path) for file in campaign.inputs]
    inputs += given_as(columns=columns, dbc=names.database, thrusters=thrusters)
    options = {
        "columns": columns, "thrusters": thrusters, "arm": arm, "figure_formats": figure_formats, "strict": strict,
    }  # fmt: skip
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
        write_figures(folder, planar_report.drawings(fit), figure_formats)
    return fit
