"""`compare`: results of two or more campaigns side by side: another vehicle, another day, another battery."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

from automarine_cli.comparison.result_files import Contents, shared_models
from automarine_cli.comparison.side_by_side import Difference, OverRuns, Side, differences
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.pipeline.manifest import MANIFEST, Input, is_manifest, read_manifest
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.pipeline.words import listed, printable
from automarine_cli.report.compare_tables import difference_table, parameter_table, sentence, summary
from automarine_cli.report.figures.compare import compare_figure
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.tables import Table
from automarine_cli.results.judged import DiagnosisFile
from automarine_cli.results.records import ResultRecord
from automarine_cli.results.shown import Shown
from automarine_cli.workflows.campaign_steps import FOLDERS
from automarine_cli.workflows.command import Command, Runner, commands, reads
from automarine_cli.workflows.shared import Drawn, numbers
from automarine_cli.workflows.view import Row, View

SCHEMA = "automarine/comparison/1"
FILES = ("comparison.json", "parameters.csv", "differences.csv", "comparison.md", "comparison.png")


@dataclass(frozen=True, repr=False)
class ResultComparison(Shown):
    """Results of one command side by side, each against the first; `notes` say what must be known of them."""

    kind: str
    sides: tuple[Side, ...]
    differences: tuple[Difference, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """The result: schema automarine/comparison/1."""
        return {
            "schema": SCHEMA,
            "kind": self.kind,
            "results": [
                {
                    "name": side.name,
                    "parameters": {name: one.to_json() for name, one in side.parameters.items()},
                    "facts": dict(side.facts),
                    "runs": side.runs,
                }
                for side in self.sides
            ],
            "differences": [one.to_json() | {"says": sentence(one)} for one in self.differences],
            "summary": summary(self.differences),
            "notes": list(self.notes),
        }

    def tables(self) -> tuple[Table, Table]:
        """Parameters side by side, and differences."""
        return parameter_table(self.sides), difference_table(self.differences)

    def sentences(self) -> list[str]:
        """What a person should read."""
        return [summary(self.differences), *(sentence(one) for one in self.differences), *self.notes]


@dataclass(frozen=True)
class _Found:
    """A result folder: its name here, its file, what is in it, the command that it is of, and how that is compared."""

    name: str
    path: Path
    file: ResultRecord
    kind: str
    contents: Callable[[Any, Sequence[str]], Contents]

    @property
    def unit(self) -> str:
        """The unit of moments or forces; nothing for thrusters."""
        return str(getattr(self.file, "force_unit", None) or "")


@dataclass(frozen=True, kw_only=True)
class _Folders:
    """Folders of results."""

    results: Sequence[Path] = field(metadata=reads("folders", "result"))


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Drawn, _Folders):
    """Folders that `fit-thrusters`, `fit-yaw`, `validate` or `diagnose` wrote, or the result files in them."""


def _compare(asked: CompareOptions, runner: Runner) -> ResultComparison:
    """Compare folders that `fit-thrusters`, `fit-yaw`, `validate` or `diagnose` wrote, all of one command, with the
    first.

    Intervals of differences take the results as made from data of their own; logs that two of them share are told.
    Validations are compared run by run.
    Raises SettingError for results that cannot be compared, ModelError for a file that automarine did not write so,
    OutputError.
    """
    folders = [one.parent if one.is_file() else one for one in asked.results]
    if len(folders) < 2:
        raise SettingError("one result was given; give two or more folders of results to compare")
    found = [_find(folder, name) for folder, name in zip(folders, _names(folders))]
    _refuse_mixtures(found)
    sides = _sides(found)
    apart = differences(sides)
    if not apart:
        raise SettingError(
            f"{listed(side.name for side in sides)}: the first has no parameter in common with another one; "
            "compare results that have the same model or form, or validations with two runs in common or more"
        )
    result = ResultComparison(found[0].kind, sides, apart, (*_notes(found, sides), *_shared_logs(found, sides)))
    inputs = [Input(f"{one.name}/{one.path.name}", one.path, "result") for one in found]
    inputs += [
        Input(f"{one.name}/{MANIFEST}", _manifest(one), "manifest") for one in found if is_manifest(_manifest(one))
    ]

    def write(folder: ResultFolder, result: ResultComparison) -> None:
        one, two = result.tables()
        folder.write_json("comparison.json", result.to_json())
        folder.write("parameters.csv", one.to_csv())
        folder.write("differences.csv", two.to_csv())
        words = Table("", ("in words",), tuple((line,) for line in result.sentences()))
        folder.write("comparison.md", "\n".join(table.to_markdown() for table in (words, one, two)))
        write_figures(folder, {"comparison": lambda: compare_figure(sides)}, asked.figure_formats)

    return runner.results(asked, lambda: result, write, inputs)


def _names(folders: Sequence[Path]) -> list[str]:
    """The last parts of each place, as many as it takes to tell them apart."""
    parts = [folder.resolve().parts for folder in folders]
    for count in range(1, max(map(len, parts)) + 1):
        names = [printable("/".join(one[-count:]).lstrip("/")) for one in parts]
        if len(set(names)) == len(names):
            return names
    twice = next(folder for i, folder in enumerate(folders) if parts[i] in parts[:i])
    raise SettingError(f"{twice} is given twice; give two or more different folders of results")


def _find(folder: Path, name: str) -> _Found:
    """The result in a folder. Raises SettingError if there is none, ModelError if it cannot be read."""
    found = {one.name: one.kept for one in commands().values() if one.kept is not None and one.kept.contents}
    files = [one.kind.file for one in found.values()]
    for command, kept in found.items():
        path = folder / kept.kind.file
        if kept.contents is not None and path.is_file():
            file = kept.kind.read(path, f"{name}/{path.name}")
            of_map = isinstance(file, DiagnosisFile) and file.of_thrusters
            return _Found(name, path, file, f"{command} of thrusters" if of_map else command, kept.contents)
    inside = [one.name for one in FOLDERS if one.kind.file in files and (folder / one.name / one.kind.file).is_file()]
    if inside:
        raise SettingError(f"{folder} holds a whole campaign; compare one step of each, such as {folder / inside[0]}")
    raise SettingError(
        f"{folder} holds no result of fit-thrusters, fit-yaw, validate or diagnose; expected one of the files "
        f"{listed(files)}"
    )


def _refuse_mixtures(found: Sequence[_Found]) -> None:
    same: tuple[tuple[str, Callable[[_Found], str], str], ...] = (
        ("results of", lambda one: one.kind, "results of one command"),
        ("results in", lambda one: one.file.dof.name, "results of one motion"),
        (
            f"{found[0].file.dof.words.force}s in",
            lambda one: one.unit,
            "results in one unit: there is no factor between the two",
        ),
    )
    for what, of, only in same:
        values = list(dict.fromkeys(map(of, found)))
        if len(values) > 1:
            told = "; ".join(f"{one.name}: {of(one)}" for one in found)
            raise SettingError(f"{what} {' and '.join(values)} cannot be compared ({told}); compare {only}")


def _sides(found: Sequence[_Found]) -> tuple[Side, ...]:
    models = shared_models([one.file for one in found])
    sides = []
    for one in found:
        try:
            parameters, facts = one.contents(one.file, models)
        except ModelError as problem:
            raise ModelError(f"{one.name}/{one.path.name}: {problem}") from None
        sides.append(Side(one.name, parameters, facts, one.file.runs.used))
    return tuple(sides)


def _notes(found: Sequence[_Found], sides: Sequence[Side]) -> list[str]:
    """What two results say differently of themselves, in words."""
    notes = []
    for fact in ("preferred model", "form", "verdict"):
        told = {side.name: side.facts[fact] for side in sides if fact in side.facts}
        if len(set(told.values())) > 1:
            notes.append(f"Not the same {fact}: {'; '.join(f'{name}: {value}' for name, value in told.items())}.")
    return notes


def _shared_logs(found: Sequence[_Found], sides: Sequence[Side]) -> list[str]:
    """Logs that two results were both made from, told by their content; of what is compared run by run how many."""
    if any(isinstance(one, OverRuns) for one in sides[0].parameters.values()):
        return ["Means over runs; differences are run by run, over the runs that both have."]
    logs = {}
    for one in found:
        if is_manifest(_manifest(one)):
            entries = read_manifest(_manifest(one)).inputs
            logs[one.name] = {entry.sha256 for entry in entries if entry.role == "log" and entry.sha256}
    return [
        f"{a} and {b} share {_logs(len(logs[a] & logs[b]))}: the intervals of their differences, "
        "which assume independent results, tend to be too wide."
        for a, b in combinations(logs, 2)
        if logs[a] & logs[b]
    ]


def _logs(count: int) -> str:
    return f"{count} log{'s' * (count != 1)}"


def _manifest(one: _Found) -> Path:
    return one.path.with_name(MANIFEST)


def _lines(result: ResultComparison) -> Iterator[str]:
    yield from (summary(result.differences), *(f"  {one}" for one in result.sentences()[1:]))


def _rows(result: ResultComparison) -> Iterator[Row]:
    for one in result.differences:
        row: Row = {"parameter": one.parameter, "of": one.of, "less": one.base} | numbers(one.difference)
        yield row | {"p_value": one.p_value, "verdict": one.verdict}


compare = Command(
    "compare", CompareOptions, _compare,
    {ResultComparison: View(
        lambda result: [*result.tables(), *result.sentences()], _lines, _rows,
        lambda result: {"intervals": lambda: compare_figure(result.sides)},
    )},
    files=lambda result: FILES,
)  # fmt: skip
