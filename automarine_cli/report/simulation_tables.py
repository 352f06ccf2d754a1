"""The result of `simulate`: the logs of a campaign, of one motion or in the plane, and the truth beside them."""

from dataclasses import dataclass
from functools import partial

from automarine_cli.pipeline.records import Record, Shown, to_mapping
from automarine_cli.report.sections import Content, Sections, sections
from automarine_cli.report.tables import Table
from automarine_cli.simulation.campaign import PlanarMade, SimulatedRun
from automarine_cli.simulation.log_files import label, log_bytes, log_of, runs_by_file
from automarine_cli.simulation.run_groups import levels_of
from automarine_cli.simulation.specification import PlanarSpecification, Specification
from automarine_cli.thrusters.map import bollard_columns

TRUTH = "truth.json"
SCHEMA = "automarine/simulation-truth/1"
DECIMALS = 9  # of what was drawn: more would show the machine's own rounding


@dataclass(frozen=True, repr=False)
class Simulation(Shown):
    """A campaign of one motion: its specification, the seed used, and its runs in the order of the campaign."""

    specification: Specification
    seed: int
    runs: tuple[SimulatedRun, ...]

    def to_json(self) -> dict[str, object]:
        """Return the truth (schema automarine/simulation-truth/1): vehicle, effects, what was drawn for each run."""
        spec, bollard = self.specification, self.specification.bollard
        thrusters = None if bollard is None else {"file": bollard.file} | _without(bollard, "folder", "name", "format")
        return {
            "schema": SCHEMA,
            "simulated": label(spec, self.seed),
            "seed": self.seed,
            "vehicle": to_mapping(spec.vehicle),
            "effects": [{"name": effect.name, **effect.values} for effect in spec.effects],
            "thrusters": thrusters,
            "logger": to_mapping(spec.logger),
            "scatter": to_mapping(spec.scatter),
            "campaign": to_mapping(spec.campaign),
            "made": [_truth_of(run, number, spec) for number, run in enumerate(self.runs, 1)],
        }


@dataclass(frozen=True, repr=False)
class PlanarSimulation(Shown):
    """The same of motion in the plane."""

    specification: PlanarSpecification
    seed: int
    runs: tuple[PlanarMade, ...]

    def to_json(self) -> dict[str, object]:
        """Return the truth (schema automarine/simulation-truth/1): vehicle, what is hidden, what was drawn."""
        return {
            "schema": SCHEMA,
            "simulated": label(self.specification, self.seed),
            "seed": self.seed,
            **_without(self.specification, "schema", "seed", "source", "runs"),
            "made": [_truth_in_plane(run) for run in self.runs],
        }


def _without(record: Record, *keys: str) -> dict[str, object]:
    return {key: value for key, value in to_mapping(record).items() if key not in keys}


@sections.register
def _(result: Simulation) -> Sections:
    spec, comment = result.specification, label(result.specification, result.seed)
    files: dict[str, Content] = {
        file: partial(log_of, runs, spec, result.seed) for file, runs in runs_by_file(result.runs).items()
    }
    groups: dict[tuple[str, str], list[SimulatedRun]] = {}
    for run in result.runs:
        groups.setdefault((run.plan.group.folder, run.plan.group.kind), []).append(run)
    rows = [_row(folder, kind, runs) for (folder, kind), runs in sorted(groups.items())]
    if (bollard := spec.bollard) is not None:
        files[bollard.file] = lambda: log_bytes(bollard_columns(bollard, result.seed), bollard.format, comment)
        readings = str(len(levels_of(bollard.levels)) * bollard.repeats)
        rows.append((bollard.folder, "bollard test", "1", "1", readings, "0"))
    header = ("folder", "kind", "runs", "files", "samples", "faulty on purpose")
    return _sections(result, header, rows, files)


@sections.register
def _(result: PlanarSimulation) -> Sections:
    comment = label(result.specification, result.seed)
    files: dict[str, Content] = {
        run.file: partial(log_bytes, run.columns, run.group.format, comment) for run in result.runs
    }
    folders: dict[str, list[PlanarMade]] = {}
    for run in result.runs:
        folders.setdefault(run.group.folder, []).append(run)
    rows: list[tuple[str, ...]] = [
        (folder, str(len(runs)), str(sum(len(run.columns["time_s"]) for run in runs)))
        for folder, runs in sorted(folders.items())
    ]
    return _sections(result, ("folder", "runs", "samples"), rows, files)


def _sections(
    result: Simulation | PlanarSimulation, header: tuple[str, ...], rows: list[tuple[str, ...]],
    files: dict[str, Content],
) -> Sections:  # fmt: skip
    truth = result.to_json()
    notes = (label(result.specification, result.seed), f"The truth is in {TRUTH}.")
    table = Table("Simulated campaign", header, tuple(rows), notes=notes)
    folders = sorted({f"{folder}/" for folder, *_ in rows if folder})
    return Sections([table], files | {TRUTH: truth}, listed=(*folders, TRUTH), rows=truth["made"])  # type: ignore[arg-type]


def _row(folder: str, kind: str, runs: list[SimulatedRun]) -> tuple[str, ...]:
    files = {run.plan.file for run in runs}
    samples = sum(len(run.log.time_s) for run in runs)
    faulty = sum(run.plan.group.fault is not None for run in runs)
    return folder, kind, *(str(number) for number in (len(runs), len(files), samples, faulty))


def _truth_of(run: SimulatedRun, number: int, specification: Specification) -> dict[str, object]:
    """What was drawn for one run, the bias of its rates if they have one; instants on the campaign's clock."""
    plan, drawn, log = run.plan, run.drawn, run.log
    words, base = specification.vehicle.dof.words, specification.vehicle.dof.units.base
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
    if specification.logger.rate_bias is not None:
        truth[f"{words.speed}_bias_{base}_s"] = _rounded(drawn.rate_bias)
    return truth if plan.group.fault is None else truth | {"fault": plan.group.fault}


def _truth_in_plane(run: PlanarMade) -> dict[str, object]:
    """The same of a run in the plane."""
    return {
        "file": run.file,
        "run": run.name,
        "start_s": _rounded(run.begin),
        "start_heading_deg": _rounded(run.heading),
        "gain": _rounded(run.gain),
        "commands": [
            {"force_X_N": x, "force_Y_N": y, "tau_Nm": n, "from_s": _rounded(run.begin + at)}
            for at, (x, y, n) in zip(run.switches.tolist(), run.commands.tolist())
        ],
        "samples": len(run.columns["time_s"]),
    }


def _rounded(value: float) -> float:
    return round(value, DECIMALS) + 0.0
