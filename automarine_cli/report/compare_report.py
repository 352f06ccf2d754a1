"""What `compare` says: parameters side by side, differences with intervals, and each in a sentence."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from automarine_cli.comparison.side_by_side import ALIKE, DIFFERS, Difference, Side
from automarine_cli.pipeline.records import Shown
from automarine_cli.report.figures.compare import compare_figure
from automarine_cli.report.sections import Content, Sections, document, numbers, sections
from automarine_cli.report.tables import MISSING, Table, number

NOTE = (
    "Each result less the first. “differs”: significant after Holm's correction for the number of comparisons; "
    "“may differ”: the 95 % interval excludes zero, as one in twenty does by chance."
)


@dataclass(frozen=True, repr=False)
class ResultComparison(Shown):
    """Results of one command side by side, each against the first; `notes` say what must be known of them."""

    kind: str
    sides: tuple[Side, ...]
    differences: tuple[Difference, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """Return the content of comparison.json: schema automarine/comparison/1."""
        return {
            "schema": "automarine/comparison/1",
            "kind": self.kind,
            "results": [
                {"name": side.name,
                 "parameters": {name: estimate.to_json() for name, estimate in side.parameters.items()},
                 "facts": dict(side.facts), "runs": side.runs}
                for side in self.sides
            ],
            "differences": [apart.to_json() | {"says": sentence(apart)} for apart in self.differences],
            "summary": summary(self.differences),
            "notes": list(self.notes),
        }  # fmt: skip


@sections.register
def _(result: ResultComparison) -> Sections:
    words = [summary(result.differences), *map(sentence, result.differences), *result.notes]
    tables = parameter_table(result.sides), difference_table(result.differences)
    files: dict[str, Content] = {
        "comparison.json": result.to_json(), "parameters.csv": tables[0].to_csv(),
        "differences.csv": tables[1].to_csv(),
        "comparison.md": document(Table.of("", [{"in words": line} for line in words]), *tables),
    }  # fmt: skip
    rows = [
        {"parameter": apart.parameter, "of": apart.of, "less": apart.base, **numbers(apart.difference),
         "p_value": apart.p_value, "verdict": apart.verdict}
        for apart in result.differences
    ]  # fmt: skip
    figures = {"comparison": partial(compare_figure, result.sides)}
    return Sections([*tables, *words], files, figures, rows=rows)


def parameter_table(sides: Sequence[Side]) -> Table:
    """Lay out parameters down, results across; then what else the results say of themselves."""
    rows = list[dict[str, object]]()
    names = dict.fromkeys(name for side in sides for name in side.parameters)
    for name in names:
        unit = next(side.parameters[name].unit for side in sides if name in side.parameters)
        label = f"{name} [{unit}]" if unit not in ("", "1") else name
        rows.append({"parameter": label} | {side.name: side.parameters.get(name) for side in sides})
    for name in dict.fromkeys(name for side in sides for name in side.facts):
        rows.append({"parameter": name} | {side.name: side.facts.get(name) for side in sides})
    rows.append({"parameter": "runs"} | {side.name: side.runs for side in sides})
    return Table.of("Side by side", rows, ["Brackets are 95 % intervals."], (len(names),))


def difference_table(found: Sequence[Difference]) -> Table:
    rows = [
        {
            "parameter": apart.parameter, "result": apart.of, "difference": apart.difference,
            "unit": apart.difference.unit,
            "%": MISSING if apart.relative is None else "{:+.1f} [{:+.1f}, {:+.1f}]".format(*apart.relative),
            "p": number(apart.p_value, 2), "verdict": apart.verdict,
        }
        for apart in found
    ]  # fmt: skip
    header = ("parameter", "result", "difference", "unit", "%", "p", "verdict")
    return Table.of(f"Against {found[0].base}" if found else "Differences", rows, [NOTE], header=header)


def sentence(difference: Difference) -> str:
    """Say one difference in words."""
    size, (low, high), name = abs(difference.difference.value), difference.difference.ci95, difference.parameter
    if difference.relative is not None:
        percent, low, high = difference.relative
        size_text, ends = f"{abs(percent):.1f} %", f"{low:+.1f} to {high:+.1f} %"
    else:
        unit = "" if difference.difference.unit in ("", "1") else f" {difference.difference.unit}"
        size_text, ends = f"{number(size, 3)}{unit}", f"{number(low, 3)} to {number(high, 3)}{unit}"
    sides = f"{difference.of} and {difference.base}"
    if difference.verdict == ALIKE:
        return f"{name}: no difference shown between {sides} (95 % interval {ends})."
    way = "larger" if difference.difference.value > 0 else "smaller"
    sure = "is" if difference.verdict == DIFFERS else "may be"
    return f"{name} {sure} {size_text} {way} in {difference.of} than in {difference.base} (95 % interval {ends})."


def summary(differences: Sequence[Difference]) -> str:
    """Say how many of the parameters differ."""
    verdicts = [difference.verdict for difference in differences]
    count, doubtful = verdicts.count(DIFFERS), sum(verdict not in (DIFFERS, ALIKE) for verdict in verdicts)
    compared = f"{len(verdicts)} parameter{'s' * (len(verdicts) != 1)} compared"
    if not count and not doubtful:
        return f"No difference shown in {compared}."
    differ = f"Of {compared} {count or 'none'} differ{'s' * (count <= 1)} beyond chance"
    return f"{differ}, {doubtful} may." if doubtful else f"{differ}."
