"""`fit-planar`: logs of motion in the plane -> surge, sway and yaw together, with what couples them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from automarine_cli.fits.known import Prior
from automarine_cli.fits.planar_fit import Estimator, PlanarFit, search
from automarine_cli.fits.planar_likelihood import PlanarLikelihood
from automarine_cli.fits.planar_structure import OWN, Observed, Structure, observed
from automarine_cli.logs import given_columns
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report import outcomes, planar_report
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.tables import Table
from automarine_cli.results.kinds import PLANAR_MODEL
from automarine_cli.runs.run import Run, command_warnings
from automarine_cli.workflows.command import UNRECORDED, Command, ReadBack, Runner
from automarine_cli.workflows.planar_runs import load_planar
from automarine_cli.workflows.shared import Beforehand, Ending, Lever, OfLogs, aligned, counted, numbers
from automarine_cli.workflows.view import Row, View

FILES = ("planar_model.json", "planar (.csv, .md, .tex)", "planar_runs.png")


@dataclass(frozen=True, kw_only=True)
class FitPlanarOptions(Beforehand, Ending, Lever, OfLogs):
    """Logs of motion in the plane, with what drives them; `estimating` makes what fits a structure."""

    estimating: Callable[[tuple[Run, ...], Observed, Mapping[str, Prior]], Estimator] = field(
        default=PlanarLikelihood, metadata=UNRECORDED
    )


def _fit_planar(asked: FitPlanarOptions, runner: Runner) -> PlanarFit:
    """Identify surge, sway and yaw together, and what couples them.

    `thrusters` and `arm` [m] turn the commands of two thrusters into force and moment. What the logs do not hold is
    tied to assumptions that the result names. `known` is what is known beforehand: {"I_r": (915, 50)}, values with or
    without a standard error. Raises LogError, RunError, FitError, SettingError or OutputError.
    """
    columns = given_columns(asked.columns)
    campaign = load_planar(
        asked.logs, columns, asked.thrusters, asked.arm, strict=asked.strict, jobs=runner.jobs, progress=runner.progress
    )  # fmt: skip
    seen, unfit = observed(campaign.runs), command_warnings(campaign.runs)
    names = Structure.simplest(seen).names
    known = asked.known.named(names, signed=sorted({*names.values()} - {*OWN}))

    def work() -> PlanarFit:
        estimator = asked.estimating(campaign.runs, seen, known.parameters)
        tried = search(campaign.runs, seen, estimator)
        limits = tuple(one.warning for one in campaign.limits)
        return PlanarFit(
            tried, estimator.choose(tried), campaign.runs, seen, campaign.set_aside, (*unfit, *limits), known
        )

    def write(folder: ResultFolder, fit: PlanarFit) -> None:
        folder.write_json("planar_model.json", fit.to_json())
        tables = planar_report.tables(fit)
        folder.write("planar.csv", tables[0].to_csv())
        sentences = "\n".join(f"{one}\n" for one in planar_report.sentences(fit))
        folder.write("planar.md", "\n".join([*(one.to_markdown() for one in tables), sentences]))
        folder.write("planar.tex", "\n".join(one.to_latex() for one in tables))
        write_figures(folder, planar_report.drawings(fit), asked.figure_formats)

    return runner.results(asked, work, write)


def _says(fit: PlanarFit) -> Sequence[Table | str]:
    first, rest = planar_report.first_sentences(fit), planar_report.sentences(fit)
    return [*first, *planar_report.tables(fit), *(one for one in rest if one not in first)]


def _lines(fit: PlanarFit) -> Iterator[str]:
    used, aside = counted(len(fit.runs), "run"), len(fit.set_aside)
    yield f"Planar model ({fit.structure}), fitted to {used}; {aside} set aside"
    yield from aligned(fit.estimates)
    yield f"  {counted(len(fit.assumptions), 'assumption')}, {counted(len(fit.warnings), 'warning')}"


def _rows(fit: PlanarFit) -> Iterator[Row]:
    for name, one in fit.estimates.items():
        yield {"parameter": name, **numbers(one)}


fit_planar = Command(
    "fit-planar", FitPlanarOptions, _fit_planar, {PlanarFit: View(_says, _lines, _rows)}, files=lambda fit: FILES,
    kept=ReadBack(PLANAR_MODEL, outcomes.of_planar),
)  # fmt: skip
