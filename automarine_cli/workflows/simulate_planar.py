"""`simulate` of motion in the plane: a specification -> logs, and the truth beside them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from automarine_cli.pipeline.records import to_mapping
from automarine_cli.report.tables import Table
from automarine_cli.results.shown import Shown
from automarine_cli.simulation.planar_campaign import PlanarMade, planar_logs
from automarine_cli.simulation.planar_specification import PlanarSpecification
from automarine_cli.workflows.shared import counted
from automarine_cli.workflows.view import Row, View

TRUTH = "truth.json"
SCHEMA = "automarine/simulation-truth/1"
DECIMALS = 9  # of what was drawn: more would show the machine's own rounding


@dataclass(frozen=True, repr=False)
class PlanarSimulation(Shown):
    """A campaign of motion in the plane that was made: its specification, the seed used, and its runs."""

    specification: PlanarSpecification
    seed: int
    runs: tuple[PlanarMade, ...]

    @property
    def label(self) -> str:
        """The sentence that every file begins with."""
        return f"Simulated by automarine from {self.specification.source}, seed {self.seed}: no measurement."

    def to_json(self) -> dict[str, object]:
        """The truth (schema automarine/simulation-truth/1): vehicle, what is hidden, what was drawn for each run."""
        asked: Mapping[str, object] = to_mapping(self.specification)
        return {
            "schema": SCHEMA,
            "simulated": self.label,
            "seed": self.seed,
            **{key: value for key, value in asked.items() if key not in ("schema", "seed", "source", "runs")},
            "made": [_truth_of(one) for one in self.runs],
        }

    def files(self) -> tuple[str, ...]:
        """What is written: the folders of logs, then the truth."""
        return (*(f"{folder}/" for folder in sorted({one.group.folder for one in self.runs})), TRUTH)

    def logs(self) -> Iterator[tuple[str, bytes]]:
        """Name and content of every log."""
        yield from planar_logs(self.runs, self.label)

    def tables(self) -> tuple[Table, ...]:
        """How many runs and samples each folder holds."""
        folders: dict[str, list[PlanarMade]] = {}
        for one in self.runs:
            folders.setdefault(one.group.folder, []).append(one)
        rows = tuple(
            (folder, str(len(runs)), str(sum(len(one.columns["time_s"]) for one in runs)))
            for folder, runs in sorted(folders.items())
        )
        notes = (self.label, f"The truth is in {TRUTH}.")
        return (Table("Simulated campaign", ("folder", "runs", "samples"), rows, notes=notes),)


def _truth_of(one: PlanarMade) -> dict[str, object]:
    """What was drawn for one run; instants on the campaign's clock."""
    return {
        "file": one.file,
        "run": one.name,
        "start_s": _rounded(one.begin),
        "start_heading_deg": _rounded(one.heading),
        "gain": _rounded(one.gain),
        "commands": [
            {"force_X_N": x, "force_Y_N": y, "tau_Nm": n, "from_s": _rounded(one.begin + at)}
            for at, (x, y, n) in zip(one.switches.tolist(), one.commands.tolist())
        ],
        "samples": len(one.columns["time_s"]),
    }


def _rounded(value: float) -> float:
    return round(value, DECIMALS) + 0.0


def _lines(result: PlanarSimulation) -> Iterator[str]:
    samples = sum(len(one.columns["time_s"]) for one in result.runs)
    yield f"{counted(len(result.runs), 'simulated run')} of motion in the plane, {samples} samples, seed {result.seed}"


def _rows(result: PlanarSimulation) -> Iterator[Row]:
    for one in result.runs:
        yield {"file": one.file, "run": one.name, "samples": len(one.columns["time_s"]), "gain": one.gain}


VIEW = View(PlanarSimulation.tables, _lines, _rows)
