"""`simulate`: a specification -> the logs of a pool campaign, and the truth beside them."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from automarine_cli.pipeline.records import read_mapping, to_mapping
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.pipeline.words import printable
from automarine_cli.report.tables import Table
from automarine_cli.results.shown import Shown
from automarine_cli.simulation.campaign import SimulatedRun, make_campaign
from automarine_cli.simulation.log_files import label, log_bytes, run_logs
from automarine_cli.simulation.planar_campaign import make_planar
from automarine_cli.simulation.planar_specification import PlanarSpecification, is_planar, planar_specification_from
from automarine_cli.simulation.run_groups import levels_of
from automarine_cli.simulation.specification import Specification, specification_from
from automarine_cli.thrusters.records import bollard_columns
from automarine_cli.workflows.command import Command, Runner, reads
from automarine_cli.workflows.shared import counted
from automarine_cli.workflows.simulate_planar import DECIMALS, SCHEMA, TRUTH, PlanarSimulation
from automarine_cli.workflows.simulate_planar import VIEW as PLANAR_VIEW
from automarine_cli.workflows.view import Row, View


@dataclass(frozen=True, repr=False)
class Simulation(Shown):
    """A campaign that was made: its specification, the seed used, and its runs in the order of the campaign."""

    specification: Specification
    seed: int
    runs: tuple[SimulatedRun, ...]

    def to_json(self) -> dict[str, object]:
        """The truth (schema automarine/simulation-truth/1): vehicle, effects, and what was drawn for each run."""
        made = self.specification
        bollard = None if made.bollard is None else to_mapping(made.bollard)
        if made.bollard is not None and bollard is not None:
            bollard = {"file": made.bollard.file} | {
                key: value for key, value in bollard.items() if key not in ("folder", "name", "format")
            }
        return {
            "schema": SCHEMA,
            "simulated": label(made, self.seed),
            "seed": self.seed,
            "vehicle": to_mapping(made.vehicle),
            "effects": [{"name": effect.name, **effect.values} for effect in made.effects],
            "thrusters": bollard,
            "logger": to_mapping(made.logger),
            "scatter": to_mapping(made.scatter),
            "campaign": to_mapping(made.campaign),
            "made": [_truth_of(run, number, made) for number, run in enumerate(self.runs, 1)],
        }

    def files(self) -> tuple[str, ...]:
        """What is written: the folders of logs, then the truth."""
        folders = {run.plan.group.folder for run in self.runs}
        if self.specification.bollard is not None:
            folders.add(self.specification.bollard.folder)
        return (*(f"{folder}/" for folder in sorted(folders) if folder), TRUTH)

    def logs(self) -> Iterator[tuple[str, bytes]]:
        """Name and content of every log."""
        asked = self.specification
        yield from run_logs(self.runs, asked, self.seed)
        if asked.bollard is not None:
            columns = bollard_columns(asked.bollard, self.seed)
            yield asked.bollard.file, log_bytes(columns, asked.bollard.format, label(asked, self.seed))

    def tables(self) -> tuple[Table, ...]:
        """How many runs, files and samples each folder holds."""
        groups: dict[tuple[str, str], list[SimulatedRun]] = {}
        for run in self.runs:
            groups.setdefault((run.plan.group.folder, run.plan.group.kind), []).append(run)
        rows = [_row(folder, kind, runs) for (folder, kind), runs in sorted(groups.items())]
        bollard = self.specification.bollard
        if bollard is not None:
            readings = str(len(levels_of(bollard.levels)) * bollard.repeats)
            rows.append((bollard.folder, "bollard test", "1", "1", readings, "0"))
        notes = (label(self.specification, self.seed), f"The truth is in {TRUTH}.")
        header = ("folder", "kind", "runs", "files", "samples", "faulty on purpose")
        return (Table("Simulated campaign", header, tuple(rows), notes=notes),)


@dataclass(frozen=True)
class SimulateOptions:
    """What is to be made; `seed` replaces the one in it."""

    specification: Path | Specification | PlanarSpecification = field(metadata=reads("file", recorded=False))
    seed: int | None = None


def _simulate(asked: SimulateOptions, runner: Runner) -> Simulation | PlanarSimulation:
    """Make the campaign of a specification, of one motion or of motion in the plane; `seed` replaces the one in it.

    Raises SettingError for a specification that makes no sense, OutputError.
    """
    given = asked.specification
    made = _specified(given) if isinstance(given, Path) else given
    used = made.seed if asked.seed is None else asked.seed

    def work() -> Simulation | PlanarSimulation:
        if isinstance(made, PlanarSpecification):
            return PlanarSimulation(made, used, make_planar(made, used))
        return Simulation(made, used, make_campaign(made, used, jobs=runner.jobs, progress=runner.progress))

    def write(folder: ResultFolder, result: Simulation | PlanarSimulation) -> None:
        for name, content in result.logs():
            folder.write(name, content)
        folder.write_json(TRUTH, result.to_json())

    return runner.results(replace(asked, seed=used), work, write)


def _specified(path: Path) -> Specification | PlanarSpecification:
    """The specification in a file, of one motion or of motion in the plane."""
    mapping, name = read_mapping(path), printable(path.name)
    return planar_specification_from(mapping, name) if is_planar(mapping) else specification_from(mapping, name)


def _row(folder: str, kind: str, runs: list[SimulatedRun]) -> tuple[str, ...]:
    """One line of the table."""
    files = {run.plan.file for run in runs}
    samples = sum(len(run.log.time_s) for run in runs)
    faulty = sum(run.plan.group.fault is not None for run in runs)
    return folder, kind, *(str(number) for number in (len(runs), len(files), samples, faulty))


def _truth_of(run: SimulatedRun, number: int, made: Specification) -> dict[str, object]:
    """What was drawn for one run, the bias of its rates if they have one; instants on the campaign's clock."""
    plan, drawn, log = run.plan, run.drawn, run.log
    words, base = made.vehicle.dof.words, made.vehicle.dof.units.base
    commands = [
        {words.force: moment, "from_s": _rounded(plan.start + instant)}
        for moment, instant in zip(plan.moments, drawn.switches.tolist())
    ]
    truth: dict[str, object] = {
        "file": plan.file,
        "run": plan.name,
        "kind": plan.group.kind,
        "number_in_campaign": number,
        "start_s": _rounded(plan.start),
        f"start_{words.position}_{base}": _rounded(drawn.start),
        f"{words.position}_zero_{base}": _rounded(drawn.zero),
        "gain": _rounded(drawn.gain),
        f"added_{words.force}": _rounded(drawn.added_moment),
        "commands": commands,
        "samples": len(log.time_s),
        "lost_samples": log.lost,
        "glitches": log.glitches,
    }
    if made.logger.rate_bias is not None:
        truth[f"{words.speed}_bias_{base}_s"] = _rounded(drawn.rate_bias)
    return truth if plan.group.fault is None else truth | {"fault": plan.group.fault}


def _rounded(value: float) -> float:
    return round(value, DECIMALS) + 0.0


def _lines(result: Simulation) -> Iterator[str]:
    names = ", ".join(effect.name for effect in result.specification.effects) or "none"
    yield f"Simulated campaign of {counted(len(result.runs), 'run')}, seed {result.seed}; effects: {names}"


def _rows(result: Simulation) -> Iterator[Row]:
    made = result.specification
    yield from (_truth_of(run, number, made) for number, run in enumerate(result.runs, 1))


simulate = Command(
    "simulate", SimulateOptions, _simulate,
    {Simulation: View(Simulation.tables, _lines, _rows), PlanarSimulation: PLANAR_VIEW},
    files=lambda result: result.files(),
)  # fmt: skip
