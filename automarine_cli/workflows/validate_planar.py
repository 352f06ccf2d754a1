"""`validate` of a planar model: simulate each log by its commands alone, compare every channel, plot."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

from automarine_cli.comparison.planar import MEANING, SCORES, PlanarFree, free_runs, overall
from automarine_cli.comparison.result_files import of_validation
from automarine_cli.errors import SettingError
from automarine_cli.logs import given_columns
from automarine_cli.models.planar_store import StoredPlanar, load_planar_model
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.results_folder import Attempt, ResultFolder, file_stems
from automarine_cli.report import outcomes
from automarine_cli.report.figures.files import Draw, Files, drawn, write_figure
from automarine_cli.report.figures.planar import planar_figure
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.results.kinds import VALIDATION
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.channels import AUTO
from automarine_cli.runs.run import SetAside, command_warnings
from automarine_cli.workflows.command import SELDOM, UNRECORDED, Command, ReadBack, Runner
from automarine_cli.workflows.planar_runs import load_planar
from automarine_cli.workflows.shared import Ending, Judged, Lever, OfLogs, counted
from automarine_cli.workflows.view import Figures, Row, View

FILES = ("validation.json", "validation.csv", "validation.md", "validation.tex", "validation_RUN.png")

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

    def to_json(self) -> dict[str, object]:
        """The result: schema automarine/validation/1."""
        runs = [one.run for one in self.free]
        return {
            "schema": VALIDATION.schema,
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
            "runs": runs_json(len(runs), self.set_aside, runs),
        }  # fmt: skip

    def tables(self) -> tuple[Table, ...]:
        """One row a run, and one over all."""
        header = ("run", "s", *(HEADINGS[name] for name in SCORES))
        rows = [
            (
                one.run.name,
                number(float(one.run.time[-1] - one.run.time[0]), 3),
                *(("diverged", *[MISSING] * 6) if one.diverged else _cells(one.scores)),
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


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """Whether a figure of every run is drawn."""

    figures: bool = True


@dataclass(frozen=True, kw_only=True)
class ValidatePlanarOptions(Ending, Pictures, Lever, Judged, OfLogs):
    """As of `validate`; nothing is drawn at random and every channel is compared."""

    channels: str = field(default=AUTO, metadata=SELDOM)
    seed: int = field(default=0, metadata=UNRECORDED)


def _validate(asked: ValidatePlanarOptions, runner: Runner) -> PlanarValidation:
    """Simulate every run with the planar model of the file `model` and compare what each sensor read.

    One figure a run is drawn unless `figures` is false. Raises LogError, RunError, ModelError, SettingError,
    OutputError.
    """
    if asked.channels != AUTO:
        raise SettingError(
            f"{asked.model.name} is a planar model: every channel of its logs is compared; leave --channels out"
        )
    stored, names, jobs, progress = (
        load_planar_model(asked.model), given_columns(asked.columns), runner.jobs, runner.progress
    )  # fmt: skip
    campaign = load_planar(
        asked.logs, names, asked.thrusters, asked.arm, strict=asked.strict, jobs=jobs, progress=progress
    )
    command_warnings(campaign.runs)  # refused where they cannot be of this map

    def work() -> PlanarValidation:
        return PlanarValidation(stored, free_runs(stored.model, campaign.runs), campaign.set_aside)

    def write(folder: ResultFolder, result: PlanarValidation) -> None:
        (table,) = result.tables()
        folder.write_json("validation.json", result.to_json())
        folder.write("validation.csv", table.to_csv())
        folder.write("validation.md", table.to_markdown())
        folder.write("validation.tex", table.to_latex())
        names, draws = ([one.run.name for one in result.free], [partial(planar_figure, one) for one in result.free])
        write_figures_of_runs(folder, names, draws, asked.figure_formats if asked.figures else (), runner)

    return runner.results(asked, work, write)


def write_figures_of_runs(
    folder: ResultFolder, names: Sequence[str], draws: Sequence[Draw], formats: Sequence[str], runner: Runner
) -> None:
    """A figure of each run in each of the formats."""
    figures = list(zip(file_stems(names), draws)) if formats else []
    draw, jobs, progress = partial(_drawn, formats=formats), runner.jobs, runner.progress
    for figure in ordered_map(draw, figures, jobs, progress=progress, stage="figures"):
        write_figure(folder, figure)


def _drawn(one: tuple[str, Draw], formats: Sequence[str]) -> Attempt[Files]:
    """The figure of one run in each of the formats."""
    stem, draw = one
    return drawn(f"validation_{stem}", draw, formats)


def _lines(result: PlanarValidation) -> Iterator[str]:
    runs, aside, scores = counted(len(result.free), "run"), len(result.set_aside), overall(result.free)
    yield f"Validation of a planar model on {runs}; {aside} set aside"
    told = ((name, scores[name]) for name in SCORES)
    yield from (f"  {name}  {number(value, 3)}" for name, value in told if value is not None)


def _rows(result: PlanarValidation) -> Iterator[Row]:
    for one in result.free:
        yield {"run": one.run.name, "model": NAME, **one.scores}


def _figures(result: PlanarValidation) -> Figures:
    return {one.run.name: partial(planar_figure, one) for one in result.free}


def files(result: object) -> tuple[str, ...]:
    """What a validation of any model leaves in its folder."""
    return FILES


validate_planar = Command(
    "validate", ValidatePlanarOptions, _validate,
    {PlanarValidation: View(PlanarValidation.tables, _lines, _rows, _figures)}, files,
    ReadBack(VALIDATION, outcomes.of_validation, of_validation), listed=False,
)  # fmt: skip
