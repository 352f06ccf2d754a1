"""`validate` of a planar model: simulate each log by its commands alone, compare every channel, plot."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from automarine_cli.comparison.planar import MEANING, SCORES, PlanarFree, free_runs, overall
from automarine_cli.errors import SettingError
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.models.planar_store import StoredPlanar, is_planar, load_planar_model
from automarine_cli.pipeline.attempts import Attempt
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import file_stems, result_folder
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.shown import Shown
from automarine_cli.report.figures.files import Files, drawn, refuse_unknown, write_figure
from automarine_cli.report.figures.planar import planar_figure
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.runs.channels import AUTO
from automarine_cli.runs.run import SetAside, readings
from automarine_cli.workflows.planar_runs import load_planar
from automarine_cli.workflows.validate import SCHEMA, Validation, validate

HEADINGS = {
    "heading_rmse_deg": "heading deg", "heading_max_abs_deg": "max deg", "position_rmse_m": "position m",
    "position_max_abs_m": "max m", "surge_rmse_m_s": "surge m/s", "sway_rmse_m_s": "sway m/s",
    "yaw_rate_rmse_deg_s": "yaw rate deg/s",
}  # fmt: skip
NAME = "planar"  # of the one model of the file


@dataclass(frozen=True, repr=False)
class PlanarValidation(Shown):
    """What `validate` found of a planar model: every run simulated, and the runs left out."""

    stored: StoredPlanar
    free: tuple[PlanarFree, ...]
    set_aside: tuple[SetAside, ...]

    def to_json(self) -> dict[str, Any]:
        """The result: schema automarine/validation/1."""
        runs = [one.run for one in self.free]
        return {
            "schema": SCHEMA,
            "motion": NAME,
            "models": {
                NAME: {
                    **overall(self.free),
                    "diverged": [one.run.name for one in self.free if one.diverged],
                    "runs": {one.run.name: {**one.scores, "start": _start(one)} for one in self.free},
                }
            },
            "best": NAME,
            "scores": MEANING,
            "logs": {
                run.name: {
                    "file": run.source, "samples": len(run), "duration_s": float(run.time[-1] - run.time[0]),
                }
                for run in runs
            },
            "runs": {
                "used": len(runs),
                "set_aside": [asdict(one) for one in self.set_aside],
                **readings(runs),
            },
        }  # fmt: skip

    def tables(self) -> tuple[Table, ...]:
        """One row a run, and one over all."""
        header = ("run", "s", *(HEADINGS[name] for name in SCORES))
        rows = [
            (
                one.run.name,
                number(float(one.run.time[-1] - one.run.time[0]), 3),
                *(("runs away", *[MISSING] * 6) if one.diverged else _cells(one.scores)),
            )
            for one in self.free
        ]
        rows.append(("all runs", MISSING, *_cells(overall(self.free))))
        notes = (
            "Free run: simulated from the start state of each log to its end by its commands alone; root mean squares "
            "of measured less simulated.",
            "A position adds up every error of speed and heading: judge a long run by its velocities.",
        )
        count = len(self.free)
        title = f"Validation over {count} run{'s' * (count != 1)}: surge, sway and yaw together"
        return (Table(title, header, tuple(rows), notes=notes),)


def _cells(scores: dict[str, float | None]) -> list[str]:
    return [MISSING if (value := scores[name]) is None else number(value, 3) for name in SCORES]


def _start(one: PlanarFree) -> dict[str, float]:
    keys = ("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")
    return dict(zip(keys, one.start))


def validate_any(
    logs: Sequence[str | Path], *, model: Path, seed: int = 0, channels: str = AUTO, **settings: Any
) -> Validation | PlanarValidation:
    """`validate` for the models of one motion, `validate_planar` for those of three together, by the schema of the
    file `model`. Raises what these raise."""
    if not is_planar(model):
        return validate(logs, model=model, seed=seed, channels=channels, **settings)
    if channels != AUTO:
        raise SettingError(
            f"{model.name} is a planar model: every channel of its logs is compared; leave --channels out"
        )
    return validate_planar(logs, model=model, **settings)


def validate_planar(
    logs: Sequence[str | Path],
    *,
    model: Path,
    columns: Path | ColumnMap | None = None,
    thrusters: Path | None = None,
    arm: float | None = None,
    out: Path | None = None,
    figures: bool = True,
    figure_formats: tuple[str, ...] = ("png",),
    overwrite: bool = False,
    strict: bool = False,
    jobs: int = 1,
    progress: Progress = silent,
) -> PlanarValidation:
    """Simulate every run with the planar model of the file `model` and compare what each sensor read.

    Writes the results if `out` is given, one figure a run unless `figures` is false. Raises LogError, RunError,
    ModelError, SettingError, OutputError.
    """
    refuse_unknown(figure_formats)
    stored, names = load_planar_model(model), given_columns(columns)
    campaign = load_planar(logs, names, thrusters, arm, strict=strict, jobs=jobs, progress=progress)

    def work() -> PlanarValidation:
        return PlanarValidation(stored, free_runs(stored.model, campaign.runs), campaign.set_aside)

    if out is None:
        return work()
    options = {
        "model": model, "columns": columns, "thrusters": thrusters, "arm": arm, "figures": figures,
        "figure_formats": figure_formats, "strict": strict,
    }  # fmt: skip
    inputs = [Input(file.name, file.path) for file in campaign.inputs]
    inputs += given_as(model=model, columns=columns, dbc=names.database, thrusters=thrusters)
    with result_folder(
        out, command="validate", options=options, inputs=inputs, seed=None, overwrite=overwrite
    ) as folder:
        result = work()
        (table,) = result.tables()
        folder.write_json("validation.json", result.to_json())
        folder.write("validation.csv", table.to_csv())
        folder.write("validation.md", table.to_markdown())
        folder.write("validation.tex", table.to_latex())
        if figures:
            stems = file_stems([one.run.name for one in result.free])
            pairs = list(zip(stems, result.free))
            for figure in ordered_map(
                partial(_drawn, formats=figure_formats), pairs, jobs, progress=progress, stage="figures"
            ):
                write_figure(folder, figure)
    return result


def _drawn(one: tuple[str, PlanarFree], formats: tuple[str, ...]) -> Attempt[Files]:
    """The figure of one run in each of the formats."""
    stem, free = one
    return drawn(f"validation_{stem}", lambda: planar_figure(free), formats)
