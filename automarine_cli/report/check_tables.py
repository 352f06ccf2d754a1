"""The result of `check`: one line for each run, one for each thruster test."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.report.sections import Content, Sections, sections
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.results.files import runs_json
from automarine_cli.results.kinds import CHECK
from automarine_cli.results.shown import Shown
from automarine_cli.runs.look import RunSeen, ThrusterTestSeen
from automarine_cli.runs.run import SetAside

NAMED = 3  # runs that share a note


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
    if result.tests:
        tables.append(_test_table(result.tests))
    rows: list[dict[str, object]] = [{"kind": f"{run.dof.name} run"} | run.to_json() for run in result.runs]
    rows += [{"kind": "thruster test"} | asdict(test) for test in result.tests]
    files: dict[str, Content] = {
        "check.json": result.to_json(),
        "check.md": "\n".join(table.to_markdown() for table in tables),
    }
    return Sections(tables, files, listed=tuple(files), rows=rows)


def _run_table(runs: Sequence[RunSeen], dof: Dof) -> Table:
    """Sampling, what was dropped, commands, and what a fit would keep of the step; reasons in the notes."""
    header = (
        "run",
        "samples",
        "s",
        "Hz",
        "jitter ms",
        "gaps",
        "dropped",
        f"noise {dof.units.shown}",
        "levels",
        "turns" if dof.wraps else dof.units.base,
        "kept of the step",
        "cut by",
        f"no {dof.words.step} because",
    )
    rows = tuple(_run_row(run, dof) for run in runs)
    return Table(f"{dof.name.capitalize()} runs", header, rows, notes=tuple(_notes(runs, dof)))


def _run_row(run: RunSeen, dof: Dof) -> tuple[str, ...]:
    dropped = sum(run.counts.get(kind, 0) for kind in ("missing", "duplicates", "glitches"))
    turn = run.half_turn
    return (
        run.run,
        str(run.samples),
        number(run.duration_s, 3),
        number(run.rate_hz, 3),
        number(run.jitter_ms, 2),
        str(run.counts.get("gaps", 0)),
        str(dropped),
        number(run.noise, 2),
        MISSING if run.levels is None else ", ".join(number(level, 3) for level in run.levels),
        number(run.extent, 2),
        MISSING
        if turn is None
        else f"{turn['kept_samples']} samples, {turn[f'{dof.words.gone_key}_{dof.units.key}']:.0f} {dof.units.shown} "
        f"of {number(turn[dof.words.force], 3)}",
        MISSING if turn is None else turn["cut_by"],
        MISSING if run.why is None else run.why.split(":")[0],
    )


def _notes(runs: Sequence[RunSeen], dof: Dof) -> list[str]:
    """What cleaning did and what a person should know; what runs share is said once."""
    words = {
        "missing": ("row with a missing value", "rows with a missing value"),
        "duplicates": ("repeated stamp", "repeated stamps"),
        "glitches": (f"{dof.position} spike", f"{dof.position} spikes"),
    }
    told: dict[str, list[str]] = {}
    for run in runs:
        dropped = [
            f"{run.counts[kind]} {one if run.counts[kind] == 1 else more} dropped"
            for kind, (one, more) in words.items()
            if run.counts.get(kind)
        ]
        for note in dict.fromkeys([*dropped, *run.notes, *([] if run.why is None else [run.why])]):
            told.setdefault(note, []).append(run.run)
    return [f"{_listed(names)}: {note}" for note, names in told.items()]


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:NAMED])
    return f"{shown} and {len(names) - NAMED} more" if len(names) > NAMED else shown


def _test_table(tests: Sequence[ThrusterTestSeen]) -> Table:
    """Points, levels and ranges; in the notes what a person should know of the reading."""
    header = ("thruster test", "points", "missing", "levels", "n from", "n to", "N from", "N to", "voltages")
    rows = tuple(
        (
            test.run,
            str(test.points),
            str(test.missing),
            str(test.levels),
            number(test.lowest_n),
            number(test.highest_n),
            number(test.lowest_force_N),
            number(test.highest_force_N),
            ", ".join(number(v, 3) for v in test.voltages) or MISSING,
        )
        for test in tests
    )
    notes = tuple(f"{test.run}: {'; '.join(test.notes)}" for test in tests if test.notes)
    return Table("Thruster tests", header, rows, notes=notes)
