"""`diagnose` on bollard tests: where a thruster map and its measurements disagree, why, and the map that closes it."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from automarine_cli.errors import RunError, SettingError
from automarine_cli.logs import Logs, given_columns
from automarine_cli.pipeline.records import Source
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report import thruster_diagnosis as page
from automarine_cli.report.figures import thruster_diagnosis as figures
from automarine_cli.report.figures.files import Draw, write_figures
from automarine_cli.results.kinds import THRUSTER_MAP
from automarine_cli.runs.channels import AUTO
from automarine_cli.thrusters.diagnosis import ThrusterDiagnosis
from automarine_cli.thrusters.diagnosis import diagnose_thrusters as diagnose_points
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.records import ThrusterLogs, load_thruster_logs
from automarine_cli.workflows.command import HOLD_OUT, SELDOM, Command, Runner, reads
from automarine_cli.workflows.fit_thrusters import cells, thrusters_pulling
from automarine_cli.workflows.shared import Columns, Ending, Judged, OfLogs
from automarine_cli.workflows.view import Figures, Row, View

FILES = ("diagnosis.json", "extended_model.json", "diagnosis.md", "where.png", "why.png", "before_after.png")


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """Logs that are never fitted (none: a quarter of the levels), and how many equal thrusters pulled together."""

    hold_out: Logs = field(default=(), metadata=reads("logs", HOLD_OUT))
    thrusters_per_test: int | None = None


@dataclass(frozen=True, kw_only=True)
class DiagnoseThrustersOptions(Columns, Ending, _Bench, Judged, OfLogs):
    """Bollard tests and the map to diagnose; `thrusters`, `arm` and `channels` belong to a motion and are refused."""

    thrusters: object = field(default=None, metadata=SELDOM)
    arm: object = field(default=None, metadata=SELDOM)
    channels: str = field(default=AUTO, metadata=SELDOM)
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        is_map = f"{self.model.name} is a thruster map"
        if self.thrusters is not None or self.arm is not None:
            raise SettingError(f"{is_map}: --thrusters and --arm belong to a yaw model; leave them out")
        if self.channels != AUTO:
            raise SettingError(f"{is_map}: --channels belongs to a motion; leave it out")


def _diagnose(asked: DiagnoseThrustersOptions, runner: Runner) -> ThrusterDiagnosis:
    """Diagnose the thruster map in `model` on bollard tests in which `thrusters_per_test` thrusters pulled.

    Without `hold_out` a quarter of the levels, drawn with `seed`, is held out. Raises LogError, RunError, FitError,
    ModelError, SettingError, OutputError.
    """
    names, strict, progress = given_columns(asked.columns), asked.strict, runner.progress
    base, with_voltage, of_map = _base(asked.model)
    loaded = load_thruster_logs(asked.logs, names, strict=strict, progress=progress)
    held = None
    if asked.hold_out:
        held = load_thruster_logs(asked.hold_out, names, strict=strict, progress=progress)
        loaded = _apart(loaded, held)
        asked = replace(asked, logs=loaded.inputs)
    count = thrusters_pulling(asked.thrusters_per_test, names, of_map)

    def work() -> ThrusterDiagnosis:
        progress("diagnosing", 0, 1)
        result = diagnose_points(
            loaded, base, hold_out=held, thrusters=count, n_unit=loaded.n_unit, voltage=with_voltage, seed=asked.seed
        )
        progress("diagnosing", 1, 1)
        return result

    def write(folder: ResultFolder, result: ThrusterDiagnosis) -> None:
        folder.write_json("diagnosis.json", result.to_json())
        folder.write_json("extended_model.json", result.extended_map)
        folder.write("diagnosis.md", page.markdown(result))
        write_figures(folder, _drawings(result), asked.figure_formats)

    return runner.results(asked, work, write)


def _drawings(result: ThrusterDiagnosis) -> dict[str, Draw]:
    return {
        "where": lambda: figures.where_figure(result),
        "why": lambda: figures.why_figure(result),
        "before_after": lambda: figures.before_after_figure(result),
    }


def _base(model: Source) -> tuple[ThrusterMap, bool, int]:
    """The map, whether its file says how thrust follows the voltage, and how many thrusters pulled in its tests."""
    found, file = ThrusterMap.load(model), THRUSTER_MAP.read(model)
    return found, "reference_V" in file.voltage_exponent, max(file.thrusters_per_test or 1, 1)


def _apart(loaded: ThrusterLogs, held: ThrusterLogs) -> ThrusterLogs:
    """The logs without those that are held out. Raises RunError if none is left."""
    out = {file.path.resolve() for file in held.inputs}
    inputs = tuple(file for file in loaded.inputs if file.path.resolve() not in out)
    names = {file.name for file in inputs}
    records = tuple(record for record in loaded.records if record.source in names)
    if not records:
        raise RunError("every log is held out; give at least one that is not named with --hold-out")
    return ThrusterLogs(records, loaded.set_aside, inputs, loaded.missing)


def _rows(result: ThrusterDiagnosis) -> Iterator[Row]:
    for effect in result.effects:
        for name, one in effect.parameters.items():
            row: Row = {"effect": effect.name, "confidence": effect.confidence, "parameter": name}
            yield row | cells(one)


def _figures(result: ThrusterDiagnosis) -> Figures:
    drawings = _drawings(result)
    return {name.replace("_", "-"): drawings[name] for name in ("before_after", "where", "why")}


diagnose_thrusters = Command(
    "diagnose", DiagnoseThrustersOptions, _diagnose,
    {ThrusterDiagnosis: View(
        lambda result: [*page.sentences(result), *page.tables(result)],
        lambda result: iter([page.verdict_sentence(result)]), _rows, _figures,
    )},
    files=lambda result: FILES, listed=False,
)  # fmt: skip
