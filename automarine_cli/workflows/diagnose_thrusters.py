"""`diagnose` on bollard tests: where a thruster map and its measurements disagree, why, and the map that closes it."""

from collections.abc import Sequence
from pathlib import Path

from automarine_cli.errors import ModelError, RunError, SettingError
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.plain_data import read_plain
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.report import thruster_diagnosis as page
from automarine_cli.report.figures import thruster_diagnosis as figures
from automarine_cli.report.figures.files import refuse_unknown, write_figures
from automarine_cli.thrusters.diagnosis import ThrusterDiagnosis
from automarine_cli.thrusters.diagnosis import diagnose_thrusters as diagnose_points
from automarine_cli.thrusters.map import SCHEMA, ThrusterMap
from automarine_cli.thrusters.records import ThrusterLogs, load_thruster_logs

FILES = (
    "diagnosis.json",
    "extended_model.json",
    "diagnosis.md",
    "where.png",
    "why.png",
    "before_after.png",
)


def is_thruster_map(model: Path) -> bool:
    """Whether a model file says that it is a thruster map; False for anything that cannot be read."""
    try:
        return read_plain(model, "JSON", ModelError).get("schema") == SCHEMA
    except ModelError:
        return False


def diagnose_thrusters(
    logs: Sequence[str | Path],
    *,
    model: Path,
    hold_out: Sequence[str | Path] = (),
    columns: Path | ColumnMap | None = None,
    out: Path | None = None,
    figure_formats: tuple[str, ...] = ("png",),
    overwrite: bool = False,
    strict: bool = False,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress = silent,
    thrusters_per_test: int | None = None,
) -> ThrusterDiagnosis:
    """Diagnose the thruster map in `model` on bollard tests in which `thrusters_per_test` thrusters pulled.

    Without `hold_out` a quarter of the levels, drawn with `seed`, is held out. Writes the results if `out` is given.
    `jobs` changes nothing: a table of levels is quick. Raises LogError, RunError, FitError, ModelError, OutputError.
    """
    refuse_unknown(figure_formats)
    column_map = given_columns(columns)
    base, with_voltage, of_map = _base(model)
    loaded = load_thruster_logs(logs, column_map, strict=strict, progress=progress)
    held = load_thruster_logs(hold_out, column_map, strict=strict, progress=progress) if hold_out else None
    if held is not None:
        loaded = _apart(loaded, held)
    count = _thrusters(thrusters_per_test, column_map, of_map)
    rule = column_map.columns.get("n")

    def judged() -> ThrusterDiagnosis:
        progress("diagnosing", 0, 1)
        result = diagnose_points(
            loaded,
            base,
            hold_out=held,
            thrusters=count,
            n_unit=(rule.unit or "") if rule is not None else "",
            voltage=with_voltage,
            seed=seed,
        )
        progress("diagnosing", 1, 1)
        return result

    if out is None:
        return judged()
    inputs = [Input(file.name, file.path) for file in loaded.inputs]
    inputs += [Input(file.name, file.path, "hold_out") for file in (held.inputs if held else ())]
    inputs += given_as(model=model, columns=columns, dbc=column_map.database)
    options = {
        "model": model.name,
        "hold_out": [file.name for file in held.inputs] if held else [],
        "thrusters_per_test": thrusters_per_test,
        "figure_formats": figure_formats,
        "strict": strict,
        "columns": columns,
    }
    with result_folder(
        out, command="diagnose", options=options, inputs=inputs, seed=seed, overwrite=overwrite
    ) as folder:
        result = judged()
        folder.write_json("diagnosis.json", result.to_json())
        folder.write_json("extended_model.json", result.extended_map)
        folder.write("diagnosis.md", page.markdown(result))
        drawings = {
            "where": lambda: figures.where_figure(result),
            "why": lambda: figures.why_figure(result),
            "before_after": lambda: figures.before_after_figure(result),
        }
        write_figures(folder, drawings, figure_formats)
    return result


def _base(model: Path) -> tuple[ThrusterMap, bool, int]:
    """The map, whether its file says how thrust follows the voltage, and how many thrusters pulled in its tests."""
    data = read_plain(model, "JSON", ModelError)
    found = ThrusterMap.from_json(data, model.name)
    voltage, count = data.get("voltage_exponent"), data.get("thrusters_per_test")
    known = isinstance(voltage, dict) and "reference_V" in voltage
    return found, known, count if isinstance(count, int) and count >= 1 else 1


def _apart(loaded: ThrusterLogs, held: ThrusterLogs) -> ThrusterLogs:
    """The logs without those that are held out. Raises RunError if none is left."""
    out = {file.path.resolve() for file in held.inputs}
    inputs = tuple(file for file in loaded.inputs if file.path.resolve() not in out)
    names = {file.name for file in inputs}
    records = tuple(record for record in loaded.records if record.source in names)
    if not records:
        raise RunError("every log is held out; give at least one that is not named with --hold-out")
    return ThrusterLogs(records, loaded.set_aside, inputs, loaded.missing)


def _thrusters(given: int | None, columns: ColumnMap, of_map: int) -> int:
    """Equal thrusters that pulled together: the option, else the column map's default, else as in the map's tests."""
    value = columns.defaults.get("thrusters_per_test", of_map) if given is None else given
    if isinstance(value, str) or value != int(value) or value < 1:
        raise SettingError(
            f"thrusters_per_test is {value!r}; expected a whole number of thrusters, 1 or more"
        )
    return int(value)
