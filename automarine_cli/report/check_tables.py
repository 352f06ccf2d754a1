"""The result of `check`: one line for each run, one for each thruster test."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.pipeline.records import Shown
from automarine_cli.pipeline.result_files import ResultKind, ResultRecord
from automarine_cli.report.sections import Sections, document, sections
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.runs.look import RunSeen, ThrusterTestSeen
from automarine_cli.runs.run import SetAside, runs_json

NAMED = 3  # runs that share a note
LEVELS = 6  # written out


@dataclass(frozen=True, kw_only=True)
class CheckFile(ResultRecord):
    """`check.json`: what is in the logs."""

    logs: int
    yaw_runs: tuple[Mapping[str, object], ...] = ()


CHECK = ResultKind("check.json", "check", CheckFile, "check", YAW)


@dataclass(frozen=True, repr=False)
class Check(Shown):
    """What is in the logs, in the order of the files; `logs` counts these."""

    runs: tuple[RunSeen, ...]
    tests: tuple[ThrusterTestSeen, ...]
    set_aside: tuple[SetAside, ...]
    logs: int

    def to_json(self) -> dict[str, object]:
        """Return the content of check.json (schema automarine/check/1)."""
        runs = {dof: [run.to_json() for run in self.runs if run.dof is dof] for dof in DOFS.values()}
        return {
            "schema": CHECK.schema,
            "logs": self.logs,
            "runs": runs_json(len(self.runs) + len(self.tests), self.set_aside),
            **{f"{dof.name}_runs": of_dof for dof, of_dof in runs.items() if dof is YAW or of_dof},
            "thruster_tests": [asdict(test) for test in self.tests],
        }


@sections.register
def _(result: Check) -> Sections:
    motions = [dof for dof in DOFS.values() if any(run.dof is dof for run in result.runs)]
    tables = [_run_table([run for run in result.runs if run.dof is dof], dof) for dof in motions]
    tables += [_test_table(result.tests)] if result.tests else []
    rows: list[dict[str, object]] = [{"kind": f"{run.dof.name} run"} | run.to_json() for run in result.runs]
    rows += [{"kind": "thruster test"} | asdict(test) for test in result.tests]
    return Sections(tables, {"check.json": result.to_json(), "check.md": document(*tables)}, rows=rows)


def _run_table(runs: Sequence[RunSeen], dof: Dof) -> Table:
    rows = []
    for run in runs:
        turn, gone = run.half_turn, f"{dof.words.gone_key}_{dof.units.key}"
        moved = turn and f"{turn[gone]:.0f} {dof.units.shown} of {number(turn[dof.words.force], 3)}"
        rows.append({
            "run": run.run, "samples": run.samples, "s": number(run.duration_s, 3), "Hz": number(run.rate_hz, 3),
            "jitter ms": number(run.jitter_ms, 2), "gaps": run.counts.get("gaps", 0),
            "dropped": sum(run.counts.get(kind, 0) for kind in ("missing", "duplicates", "glitches")),
            f"noise {dof.units.shown}": number(run.noise, 2), "levels": _levels(run.levels),
            "turns" if dof.wraps else dof.units.base: number(run.extent, 2),
            "kept of the step": turn and f"{turn['kept_samples']} samples, {moved}",
            "cut by": turn and turn["cut_by"],
            f"no {dof.words.step} because": run.why and run.why.split(":")[0],
        })  # fmt: skip
    return Table.of(f"{dof.name.capitalize()} runs", rows, _notes(runs, dof)).without_empty_columns()


def _levels(levels: Sequence[float] | None) -> str:
    if not levels:
        return MISSING
    if len(levels) <= LEVELS:
        return ", ".join(number(level, 3) for level in levels)
    return f"{len(levels)} from {number(min(levels), 3)} to {number(max(levels), 3)}"


def _notes(runs: Sequence[RunSeen], dof: Dof) -> list[str]:
    """What cleaning did and what a person should know; what runs share is said once."""
    words = {"missing": "row~ with a missing value", "duplicates": "repeated stamp~",
             "glitches": f"{dof.position} spike~"}  # fmt: skip
    notes: dict[str, list[str]] = {}
    for run in runs:
        counts = [(run.counts.get(kind, 0), word) for kind, word in words.items()]
        dropped = [f"{count} {word.replace('~', 's' * (count != 1))} dropped" for count, word in counts if count]
        for note in dict.fromkeys([*dropped, *run.notes, *([] if run.why is None else [run.why])]):
            notes.setdefault(note, []).append(run.run)
    more = {note: f" and {len(names) - NAMED} more" * (len(names) > NAMED) for note, names in notes.items()}
    return [f"{', '.join(names[:NAMED])}{more[note]}: {note}" for note, names in notes.items()]


def _test_table(tests: Sequence[ThrusterTestSeen]) -> Table:
    rows = [
        {
            "thruster test": test.run, "points": test.points, "missing": test.missing, "levels": test.levels,
            "n from": number(test.lowest_n), "n to": number(test.highest_n), "N from": number(test.lowest_force_N),
            "N to": number(test.highest_force_N),
            "voltages": ", ".join(number(v, 3) for v in test.voltages) or MISSING,
        }
        for test in tests
    ]  # fmt: skip
    return Table.of("Thruster tests", rows, [f"{test.run}: {'; '.join(test.notes)}" for test in tests if test.notes])
