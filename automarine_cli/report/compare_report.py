"""What `compare` says: parameters side by side, and differences with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

from automarine_cli.comparison.side_by_side import DIFFERS, MAY_DIFFER, ComparedResult, Difference
from automarine_cli.pipeline.records import Shown
from automarine_cli.report.sections import Content, Drawing, Sections, document, numbers, sections
from automarine_cli.report.tables import Table, escape, number

NOTE = (
    "Each result minus the first. “Differs” is significant after Holm's correction for the number of comparisons. "
    "“May differ” is an interval of 95 % without zero, as one in twenty is by chance."
)


@dataclass(frozen=True, repr=False)
class ResultComparison(Shown):
    """Results of one `kind` of command side by side (`sides`), their `differences` from the first, and `notes` on what
    must be known of them. `to_json()` is comparison.json.

    Frame, a row per difference: `parameter`, `of`, `less`, `value`, `stderr`, `low`, `high`, `unit`, `p_value`,
    `verdict`.

    Keys: `schema`, `kind`, `results`, `differences`, `summary`, `notes`.
    """

    kind: str
    sides: tuple[ComparedResult, ...]
    differences: tuple[Difference, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        return {
            "schema": "automarine/comparison/1",
            "kind": self.kind,
            "results": [
                {"name": side.name,
                 "parameters": {name: estimate.to_json() for name, estimate in side.parameters.items()},
                 "facts": dict(side.facts), "runs": side.runs}
                for side in self.sides
            ],
            "differences": [apart.to_json() for apart in self.differences],
            "summary": summary(self.differences),
            "notes": list(self.notes),
        }  # fmt: skip


@sections.register
def _(result: ResultComparison) -> Sections:
    words = [summary(result.differences), *result.notes]
    tables = parameter_table(result.sides), difference_table(result.differences)
    files: dict[str, Content] = {
        "comparison.json": result.to_json(), "parameters.csv": tables[0].to_csv(),
        "differences.csv": tables[1].to_csv(), "comparison.md": document(*map(escape, words), *tables),
    }  # fmt: skip
    rows = [
        {"parameter": apart.parameter, "of": apart.of, "less": apart.base, **numbers(apart.difference),
         "p_value": apart.p_value, "verdict": apart.verdict}
        for apart in result.differences
    ]  # fmt: skip
    figures = {"comparison": Drawing("parameters.compare_figure", result.sides, result.differences)}
    return Sections([*tables, *words], files, figures, rows=rows)


def parameter_table(sides: Sequence[ComparedResult]) -> Table:
    """Lay out parameters down, results across; then what else the results say of themselves."""
    units = {name: estimate.unit for side in reversed(sides) for name, estimate in side.parameters.items()}
    names = dict.fromkeys(name for side in sides for name in side.parameters)
    facts = dict.fromkeys(name for side in sides for name in side.facts)
    rows: list[dict[str, object]] = [
        {"parameter": f"{name} [{units[name]}]" if units[name] not in ("", "1") else name}
        | {side.name: side.parameters.get(name) for side in sides}
        for name in names
    ]
    rows += [{"parameter": name} | {side.name: side.facts.get(name) for side in sides} for name in facts]
    rows.append({"parameter": "runs"} | {side.name: side.runs for side in sides})
    return Table.of("Side by side", rows, ["Brackets are 95 % intervals."], (len(names),))


def difference_table(differences: Sequence[Difference]) -> Table:
    rows = [
        {
            "parameter": apart.parameter, "result": apart.of, "verdict": apart.verdict,
            "difference": apart.difference, "unit": apart.difference.unit, "p": number(apart.p_value, 2),
            "%": apart.relative and "{:+.1f} [{:+.1f}, {:+.1f}]".format(*apart.relative),
        }
        for apart in differences
    ]  # fmt: skip
    return Table.of(f"Against {differences[0].base}", rows, [NOTE])


def summary(differences: Sequence[Difference]) -> str:
    verdicts = [apart.verdict for apart in differences]
    differ, may = verdicts.count(DIFFERS), verdicts.count(MAY_DIFFER)
    return f"Parameters compared: {len(verdicts)}; {differ} differ beyond chance, {may} may differ."
