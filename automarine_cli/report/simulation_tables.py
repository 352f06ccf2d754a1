"""The result of `simulate`: the logs of a campaign and the truth beside them."""

from dataclasses import dataclass
from functools import partial
from typing import Any

from automarine_cli.pipeline.records import Shown, plain, to_mapping
from automarine_cli.report.sections import Content, Sections, sections
from automarine_cli.report.tables import Table
from automarine_cli.simulation.campaign import SimulatedRun, label, log_bytes, log_of, runs_by_file
from automarine_cli.simulation.specification import Specification, levels_of
from automarine_cli.thrusters.map import bollard_columns

TRUTH = "truth.json"
TRUTH_DECIMALS = 9  # of what was drawn: more would show the machine's own rounding


@dataclass(frozen=True, repr=False)
class Simulation(Shown):
    """A campaign: its specification, the seed used, and its runs in the order of the campaign."""

    specification: Specification
    seed: int
    runs: tuple[SimulatedRun, ...]

    def to_json(self) -> dict[str, object]:
        """Return the truth (schema automarine/simulation-truth/1): vehicle, effects, what was drawn for each run."""
        spec, thrusters = self.specification, None
        if (bollard := spec.bollard) is not None:
            thrusters = {"file": bollard.file} | to_mapping(bollard)
            thrusters = {key: value for key, value in thrusters.items() if key not in ("folder", "name", "format")}
        planar = ("hidden", "disturbance", "sensors") if spec.motion.turns else ()
        return {
            "schema": "automarine/simulation-truth/1", "simulated": label(spec, self.seed), "seed": self.seed,
            "vehicle": to_mapping(spec.vehicle),
            **{key: plain(getattr(spec, key)) for key in planar},
            "effects": [{"name": effect.name, **effect.values} for effect in spec.effects],
            "thrusters": thrusters,
            **{key: to_mapping(getattr(spec, key)) for key in ("logger", "scatter", "campaign")},
            "made": [_truth_of(run, number, spec) for number, run in enumerate(self.runs, 1)],
        }  # fmt: skip


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
    table, listed = Table.of("Simulated campaign", rows), (*folders, TRUTH)
    return Sections([table], files | {TRUTH: truth}, listed=listed, rows=made, answer=comment)


def _truth_of(run: SimulatedRun, number: int, specification: Specification) -> dict[str, object]:
    """What was drawn for one run, the bias of its rates if they have one; instants on the campaign's clock."""
    plan, dofs = run.plan, specification.motion.dofs
    words, base, columns = dofs[-1].words, dofs[-1].units.base, [*specification.columns]
    position, rate = columns[len(dofs) - 1], columns[-1]
    forces = [dof.command for dof in dofs] if len(dofs) > 1 else [words.force]
    truth: dict[str, object] = {
        "file": plan.file, "run": plan.name, "kind": plan.group.kind, "number_in_campaign": number,
        "start_s": _rounded(plan.start), f"start_{words.position}_{base}": _rounded(run.start),
        f"{words.position}_zero_{base}": _rounded(dofs[-1].inner(run.biases[position])), "gain": _rounded(run.gain),
        f"added_{words.force}": _rounded(run.added_moment),
        "commands": [
            dict(zip(forces, values)) | {"from_s": _rounded(plan.start + instant)}
            for values, instant in zip(plan.moments, run.switches.tolist())
        ],
        "samples": len(run.columns["time_s"]),
    }  # fmt: skip
    if specification.logger.rate_bias is not None or (len(dofs) > 1 and rate in run.biases):
        truth[f"{words.speed}_bias_{base}_s"] = _rounded(dofs[-1].inner(run.biases[rate]))
    return truth if plan.group.fault is None else truth | {"fault": plan.group.fault}


def _rounded(value: float) -> float:
    return round(value, TRUTH_DECIMALS) + 0.0
