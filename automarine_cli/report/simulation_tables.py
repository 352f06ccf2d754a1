"""The result of `simulate`: the logs of a campaign and the truth beside them."""

from dataclasses import dataclass
from functools import partial
from typing import Any

from automarine_cli.dofs import YAW
from automarine_cli.pipeline.records import Record, Shown, to_mapping
from automarine_cli.report.sections import Content, Sections, sections
from automarine_cli.report.tables import Table
from automarine_cli.simulation.campaign import SimulatedRun, label, log_bytes, log_of, runs_by_file
from automarine_cli.simulation.specification import AnySpecification, PlanarSpecification, Specification, levels_of
from automarine_cli.thrusters.map import bollard_columns

TRUTH = "truth.json"
DECIMALS = 9  # of what was drawn: more would show the machine's own rounding


@dataclass(frozen=True, repr=False)
class Simulation(Shown):
    """A campaign: its specification, the seed used, and its runs in the order of the campaign."""

    specification: AnySpecification
    seed: int
    runs: tuple[SimulatedRun, ...]

    def to_json(self) -> dict[str, object]:
        """Return the truth (schema automarine/simulation-truth/1): vehicle, effects, what was drawn for each run."""
        spec = self.specification
        head = {"schema": "automarine/simulation-truth/1", "simulated": label(spec, self.seed), "seed": self.seed}
        if isinstance(spec, PlanarSpecification):
            truth = [_truth_in_plane(run) for run in self.runs]
            return {**head, **_without(spec, "schema", "seed", "source", "runs"), "made": truth}
        bollard = spec.bollard
        thrusters = None if bollard is None else {"file": bollard.file} | _without(bollard, "folder", "name", "format")
        return {
            **head,
            "vehicle": to_mapping(spec.vehicle),
            "effects": [{"name": effect.name, **effect.values} for effect in spec.effects],
            "thrusters": thrusters,
            **{key: to_mapping(getattr(spec, key)) for key in ("logger", "scatter", "campaign")},
            "made": [_truth_of(run, number, spec) for number, run in enumerate(self.runs, 1)],
        }


def _without(record: Record, *keys: str) -> dict[str, object]:
    return {key: value for key, value in to_mapping(record).items() if key not in keys}


@sections.register
def _(result: Simulation) -> Sections:
    spec, comment, truth = result.specification, label(result.specification, result.seed), result.to_json()
    files: dict[str, Content] = {
        file: partial(log_of, runs, spec, result.seed) for file, runs in runs_by_file(result.runs).items()
    }
    groups: dict[tuple[str, str], list[SimulatedRun]] = {}
    for run in result.runs:
        groups.setdefault((run.plan.group.folder, run.plan.group.kind), []).append(run)
    rows = [
        {"folder": folder, "kind": kind, "runs": len(runs), "files": len({run.plan.file for run in runs}),
         "samples": sum(len(run.columns["time_s"]) for run in runs),
         "faulty on purpose": sum(run.plan.group.fault is not None for run in runs)}
        for (folder, kind), runs in sorted(groups.items())
    ]  # fmt: skip
    if (bollard := spec.bollard) is not None:
        files[bollard.file] = lambda: log_bytes(bollard_columns(bollard, result.seed), bollard.format, comment)
        readings = len(levels_of(bollard.levels)) * bollard.repeats
        rows.append({"folder": bollard.folder, "kind": "bollard test", "runs": 1, "files": 1, "samples": readings,
                     "faulty on purpose": 0})  # fmt: skip
    folders = sorted({f"{row['folder']}/" for row in rows if row["folder"]})
    made: Any = truth["made"]
    printed: list[Table | str] = [Table.of("Simulated campaign", rows), f"The truth is in {TRUTH}."]
    return Sections(printed, files | {TRUTH: truth}, listed=(*folders, TRUTH), rows=made, answer=comment)


def _truth_of(run: SimulatedRun, number: int, specification: Specification) -> dict[str, object]:
    """What was drawn for one run, the bias of its rates if they have one; instants on the campaign's clock."""
    plan, dof = run.plan, specification.vehicle.dof
    words, base = dof.words, dof.units.base
    truth: dict[str, object] = {
        "file": plan.file, "run": plan.name, "kind": plan.group.kind, "number_in_campaign": number,
        "start_s": _rounded(plan.start), f"start_{words.position}_{base}": _rounded(run.start),
        f"{words.position}_zero_{base}": _rounded(run.zero), "gain": _rounded(run.gain),
        f"added_{words.force}": _rounded(run.added_moment),
        "commands": [
            {words.force: moment, "from_s": _rounded(plan.start + instant)}
            for moment, instant in zip(plan.moments, run.switches.tolist())
        ],
        "samples": len(run.columns["time_s"]), "lost_samples": run.lost, "glitches": run.glitches,
    }  # fmt: skip
    if specification.logger.rate_bias is not None:
        truth[f"{words.speed}_bias_{base}_s"] = _rounded(run.rate_bias)
    return truth if plan.group.fault is None else truth | {"fault": plan.group.fault}


def _truth_in_plane(run: SimulatedRun) -> dict[str, object]:
    plan = run.plan
    return {
        "file": plan.file, "run": plan.name, "start_s": _rounded(plan.start),
        "start_heading_deg": _rounded(float(YAW.logged(run.start))), "gain": _rounded(run.gain),
        "commands": [
            {"force_X_N": x, "force_Y_N": y, "tau_Nm": n, "from_s": _rounded(plan.start + instant)}
            for instant, (x, y, n) in zip(run.switches.tolist(), plan.moments)
        ],
        "samples": len(run.columns["time_s"]),
    }  # fmt: skip


def _rounded(value: float) -> float:
    return round(value, DECIMALS) + 0.0
