"""What is shown of logs without a fit: the runs and thruster tests that `check` lists, what `slice` cuts, and what
`simulate` makes, with the truth beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.models.store import Sensor
from automarine_cli.pipeline.records import ResultKind, ResultRecord, Shown, plain, to_mapping
from automarine_cli.report.sections import Content, Drawing, Sections, document, file_stems, sections
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.runs.look import RunSeen, ThrusterTestSeen
from automarine_cli.runs.run import ExcludedRun, runs_json
from automarine_cli.simulation.campaign import SimulatedRun, label, log_bytes, log_of, runs_by_file
from automarine_cli.simulation.specification import Specification, levels_of
from automarine_cli.text import plural
from automarine_cli.thrusters.map import bollard_columns

MAX_RUNS_OF_NOTE = 3  # that are named
MAX_LEVELS_WRITTEN = 6  # written out
RUNS_ON_A_PAGE, MAX_RUNS_DRAWN = 20, 100
RUNS, MOVING = "runs", "moving"  # folders of what was cut


@dataclass(frozen=True, kw_only=True)
class CheckFile(ResultRecord):
    logs: int
    yaw_runs: tuple[Mapping[str, object], ...] = ()


CHECK = ResultKind("check.json", "check", CheckFile, "check", YAW)


@dataclass(frozen=True, repr=False)
class Check(Shown):
    """What is in the logs, in the order of the files: `logs` is how many were read, `runs` and `tests` (of thrusters)
    what they contain, `set_aside` the runs that cannot be used, each with the reason. `to_json()` is check.json.

    Frame, a row per run: `kind`, `file`, `run`, `samples`, `begins_s`, `duration_s`, `rate_hz`, `jitter_ms`,
    `longest_step_s`, `counts`, `heading_noise_deg`, `turns`, `moment_unit`, `levels`, `steps`, `half_turn`, `why`,
    `columns`, `notes`.

    Keys: `schema`, `logs`, `runs`, `yaw_runs`, `thruster_tests`.
    """

    runs: tuple[RunSeen, ...]
    tests: tuple[ThrusterTestSeen, ...]
    set_aside: tuple[ExcludedRun, ...]
    logs: int

    def to_json(self) -> dict[str, object]:
        runs = {dof: [run.to_json() for run in self.runs if run.dof is dof] for dof in DOFS.values()}
        return {
            "schema": CHECK.schema, "logs": self.logs,
            "runs": runs_json(len(self.runs) + len(self.tests), self.set_aside),
            **{f"{dof.name}_runs": of_dof for dof, of_dof in runs.items() if dof is YAW or of_dof},
            "thruster_tests": [asdict(test) for test in self.tests],
        }  # fmt: skip


def run_pages(seen: Sequence[RunSeen]) -> dict[str, Drawing]:
    """Drawings of runs as logged, by name: those of each motion, so many on a page; of many the unusable ones first."""
    return {
        f"{dof.name}_runs_{page}": Drawing("runs.logs_figure", runs[first : first + RUNS_ON_A_PAGE])
        for dof in DOFS.values()
        for runs in [_drawn([run for run in seen if run.dof is dof])]
        for page, first in enumerate(range(0, len(runs), RUNS_ON_A_PAGE), 1)
    }


def _drawn(runs: Sequence[RunSeen]) -> Sequence[RunSeen]:
    return runs if len(runs) <= MAX_RUNS_DRAWN else sorted(runs, key=lambda run: not run.why)[:MAX_RUNS_DRAWN]


@sections.register
def _(result: Check) -> Sections:
    tables, usable, figures = list[Table](), list[str](), run_pages(result.runs)
    for dof in DOFS.values():
        if runs := [run for run in result.runs if run.dof is dof]:
            count = sum(not run.why for run in runs)
            entirely = "" if count else ", so a fit takes them whole"
            if dof.restoring:
                count, entirely = sum(run.why is None for run in runs), ", which a fit takes whole"
            tables.append(_run_table(runs, dof))
            usable.append(f"{count} of {len(runs)} {dof.name} runs have a usable {dof.words.step}{entirely}")
    if result.tests:
        tables.append(_test_table(result.tests))
        usable.append(plural(len(result.tests), "thruster test"))
    answer, notes = "; ".join(usable) + ".", [note for table in tables for note in table.notes]
    if any(sum(run.dof is dof for run in result.runs) > MAX_RUNS_DRAWN for dof in DOFS.values()):
        notes.append(f"The figures show {MAX_RUNS_DRAWN} runs of a motion, those without a step to fit first.")
    rows: list[dict[str, object]] = [{"kind": f"{run.dof.name} run"} | run.to_json() for run in result.runs]
    rows += [{"kind": "thruster test"} | asdict(test) for test in result.tests]
    files: dict[str, Content] = {"check.json": result.to_json(), "check.md": document(*tables)}
    details = [replace(table, notes=()) for table in tables]
    return Sections(notes, files, figures, rows=rows, answer=answer, details=details)


def _run_table(runs: Sequence[RunSeen], dof: Dof) -> Table:
    rows, notes = [], dict[str, list[str]]()
    words = {"missing": "missing value", "duplicates": "repeated stamp", "glitches": f"{dof.position} spike"}
    for run in runs:
        turn, key = run.half_turn, f"{dof.words.gone_key}_{dof.units.shown}"
        moved = turn and f"{turn[key]:.0f} {dof.units.shown} of {number(turn[dof.words.force], 3)}"
        dropped = {word: run.counts.get(kind, 0) for kind, word in words.items()}
        levels = ", ".join(number(level, 3) for level in run.levels or ())
        if run.levels and len(run.levels) > MAX_LEVELS_WRITTEN:
            levels = f"{len(run.levels)} from {number(min(run.levels), 3)} to {number(max(run.levels), 3)}"
        rows.append({
            "run": run.run, "samples": run.samples, "s": number(run.duration_s, 3), "Hz": number(run.rate_hz, 3),
            "jitter ms": number(run.jitter_ms, 2), "gaps": run.counts.get("gaps", 0),
            "dropped": sum(dropped.values()),
            f"noise {dof.units.shown}": number(run.noise, 2), "levels": levels or None,
            "turns" if dof.wraps else dof.units.log: number(run.extent, 2),
            "kept of the step": turn and f"{turn['kept_samples']} samples, {moved}",
            "cut by": turn and turn["cut_by"],
            f"no {dof.words.step} because": run.why and run.why.split(":")[0],
        })  # fmt: skip
        remarks = [f"{plural(n, word)} dropped" for word, n in dropped.items() if n]
        for note in dict.fromkeys([*remarks, *run.notes, *filter(None, [run.why])]):
            notes.setdefault(note, []).append(run.run)
    lines = []
    for note, names in notes.items():  # what runs share is said once
        more = f" and {len(names) - MAX_RUNS_OF_NOTE} more" if len(names) > MAX_RUNS_OF_NOTE else ""
        lines.append(f"{', '.join(names[:MAX_RUNS_OF_NOTE])}{more}: {note}")
    return Table.of(f"{dof.name.capitalize()} runs", rows, lines).without_empty_columns()


def _test_table(tests: Sequence[ThrusterTestSeen]) -> Table:
    rows = [
        {
            "thruster test": test.run, "points": test.points, "missing": test.missing, "levels": test.levels,
            "n from": test.lowest_n, "n to": test.highest_n, "N from": test.lowest_force_N,
            "N to": test.highest_force_N, "voltages": ", ".join(number(v, 3) for v in test.voltages) or MISSING,
        }
        for test in tests
    ]  # fmt: skip
    return Table.of("Thruster tests", rows, [f"{test.run}: {'; '.join(test.notes)}" for test in tests if test.notes])


@dataclass(frozen=True)
class SlicedLog:
    """One log that was cut: its runs as slices.json has them and the content of their files, the intervals between
    them with the reason why they became no run, notes of the reading."""

    file: str
    cuts: tuple[Mapping[str, Any], ...]
    contents: tuple[bytes, ...]
    between: tuple[Mapping[str, Any], ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Slices(Shown):
    """How logs were cut into runs `by` a command or mode, and written in a `form` (csv, parquet): `cuts`, a mapping per
    run; `sources`, the logs; `set_aside`, what could not be cut. `to_json()` is slices.json.

    Frame, a row per run: `file`, `run`, `state`, `source`, `source_run`, `rows`, `samples`, `moving`, `from_s`, `to_s`.

    Keys: `schema`, `by`, `slices`, `left_out`, `sources`, `runs`.
    """

    by: str
    form: str
    sources: tuple[SlicedLog, ...]
    set_aside: tuple[ExcludedRun, ...]

    @property
    def cuts(self) -> list[dict[str, Any]]:
        """The runs with their files; those that begin in motion have a folder of their own."""
        cuts = [cut for source in self.sources for cut in source.cuts]
        stems = file_stems([cut["run"] for cut in cuts])
        folders = [MOVING if cut["moving"] else RUNS for cut in cuts]
        return [{"file": f"{at}/{stem}.{self.form}", **cut} for at, stem, cut in zip(folders, stems, cuts)]

    def to_json(self) -> dict[str, Any]:
        cuts = self.cuts
        return {
            "schema": "automarine/slices/1", "by": self.by, "slices": cuts,
            "left_out": [gap for source in self.sources for gap in source.between],
            "sources": [{"file": source.file, "notes": list(source.notes)} for source in self.sources],
            "runs": runs_json(len(cuts), self.set_aside),
        }  # fmt: skip


@sections.register
def _(result: Slices) -> Sections:
    content, cuts = result.to_json(), result.cuts
    rows = [
        {"run": cut["run"], result.by: cut["state"], "log": cut["source"], "rows": "{} to {}".format(*cut["rows"]),
         "from s": _seconds(cut["from_s"]), "to s": _seconds(cut["to_s"]),
         "lasts s": number(cut["to_s"] - cut["from_s"], 3)}
        for cut in cuts
    ]  # fmt: skip
    moving, logs = sum(cut["moving"] for cut in cuts), plural(len(result.sources), "log")
    answer = f"{plural(len(cuts), 'run')} cut from {logs} by {result.by}"
    if moving:
        answer += f", of which {moving} begin in motion, in the folder {MOVING}"
    notes = [f"{source.file}: {note}" for source in result.sources for note in source.notes]
    notes += [f"{gap['source']}, {interval_of(gap)}: {gap['why']}" for gap in content["left_out"]]
    table = Table.of("Runs", rows, notes)
    logs_cut = (log for source in result.sources for log in source.contents)
    files: dict[str, Content] = dict(zip((cut["file"] for cut in cuts), logs_cut))
    files |= {"slices.json": content, "slices.md": table.to_markdown()}
    listed = ("slices.json", "slices.md", *dict.fromkeys(cut["file"].partition("/")[0] + "/" for cut in cuts))
    return Sections([f"{answer}.", table], files, listed=listed, rows=cuts)


def interval_of(part: Mapping[str, Any]) -> str:
    """Write the interval of a log in seconds of its clock."""
    return f"{_seconds(part['from_s'])} to {_seconds(part['to_s'])} s"


def _seconds(value: float) -> str:
    return f"{value:.3f}".rstrip("0").rstrip(".")


TRUTH = "truth.json"
TRUTH_DECIMALS = 9  # of what was drawn: more would show the machine's own rounding


@dataclass(frozen=True, repr=False)
class Simulation(Shown):
    """A campaign with known truth: its `specification`, the `seed` used, and its `runs` in the order of the campaign.
    `to_json()` is truth.json.

    Frame, a row per run: `file`, `run`, `kind`, `number_in_campaign`, `start_s`, `start_heading_rad`,
    `heading_zero_rad`, `gain`, `added_moment`, `commands`, `samples`, `fault`.

    Keys: `schema`, `simulated`, `seed`, `vehicle`, `effects`, `thrusters`, `logger`, `scatter`, `campaign`, `made`.
    """

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


@dataclass(frozen=True, repr=False)
class Samples(Shown):
    """The sample logs as copied: the folder `out`, and the `files` in it. `to_json()` lists them. There is no frame.

    Keys: `schema`, `files`.
    """

    out: Path
    files: tuple[Path, ...]

    def to_json(self) -> dict[str, object]:
        """Return the names of the files (schema automarine/samples/1)."""
        return {"schema": "automarine/samples/1", "files": [path.as_posix() for path in self.files]}


@sections.register
def _(result: Samples) -> Sections:
    listed = sorted({f"{path.parts[0]}/" for path in result.files if len(path.parts) > 1})
    answer = f"{len(result.files)} sample files: simulated logs of known truth, and those of a real boat."
    return Sections([], listed=listed, answer=answer)


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


def sensor_sentences(sensors: Sequence[Sensor], dof: Dof) -> list[str]:
    """Say which sensors count, and of each other why not; none where only positions are logged."""
    if not sensors:
        return []
    words, used, lines = {dof.position: dof.words.position, dof.velocity: dof.words.rate}, [], []
    for sensor in sensors:
        name, noise = words.get(sensor.quantity, sensor.quantity), sensor.noise
        if sensor.used:
            bound = ", at its bound" if noise is not None and noise.at_bound else ""
            used.append(name if noise is None else f"{name} (noise {noise.value:.3g} {noise.unit}{bound})")
        if sensor.why:
            lines.append(sensor.why if sensor.used else f"The {name} does not count. {sensor.why}")
    return [f"Sensors used: {' and '.join(used)}.", *lines]
