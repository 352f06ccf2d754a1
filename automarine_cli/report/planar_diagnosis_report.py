"""What `diagnose` shows of a planar model: sentences, tables, the page for a person, figures."""

from functools import partial

from automarine_cli.diagnosis.planar import HEAD_START, PlanarDiagnosis, PlanarSearch
from automarine_cli.diagnosis.residual_regions import Where
from automarine_cli.diagnosis.verdict import Outlook
from automarine_cli.dofs import YAW
from automarine_cli.report.figures.planar_diagnosis import before_after_figure, where_figure, why_figure
from automarine_cli.report.sections import Content, Sections, numbers, sections
from automarine_cli.report.tables import MISSING, Table, number

MOST_REGIONS = 8


def verdict_sentence(search: PlanarSearch) -> str:
    """The verdict in one sentence with its numbers."""
    if search.verdict == "nothing-missing":
        return "Nothing is missing that the runs could show."
    if search.verdict == "unexplained":
        return f"Unexplained. {search.why}"
    if search.verdict == "suspected":
        return f"Suspected: {search.words.removeprefix('suspected ')}. {search.why}"
    held_out = search.outlook(True)
    judged = held_out and (held_out.judged or held_out.ahead[-1])
    if not judged:
        return f"Named: {search.words}."
    before, after = (f"{YAW.shown(x):.3g}" for x in (judged.before, judged.after))
    return (
        f"Named: {search.words}; on runs held out the heading is predicted {judged.horizon:g} s ahead to {after} "
        f"deg, {before} before."
    )


def tables(search: PlanarSearch) -> list[Table | str]:
    """The verdict, the evidence, the predictions."""
    told: list[Table | str] = [verdict_sentence(search)]
    for one in search.steps:
        if one.best is not None:
            told.append(f"{one.best.candidate.name}: {one.best.candidate.says}")
        told += [f"Cannot be excluded: {rival.candidate.label}: {rival.candidate.split_by}" for rival in one.rivals]
    return [*told, _evidence(search), *_predictions(search)]


def _evidence(search: PlanarSearch) -> Table:
    """One row a candidate that was fitted, look by look, the best first."""
    rows = []
    for i, one in enumerate(search.rounds, 1):
        best, rivals = one.best and one.best.candidate.added, [r.candidate.added for r in one.rivals]
        for each in sorted(one.tried, key=lambda each: -each.surplus):
            added = each.candidate.added
            word = "named" if added == best else "rival" if added in rivals else MISSING
            word = "suspected" if each in search.suspected else word
            word = "some runs only" if word == MISSING and each is search.passed_over else word
            rows.append((str(i), each.candidate.label, number(each.surplus, 4), number(each.held_out, 4), word))
    header = ("look", "effect", "deviance gained", "held-out log likelihood gained", "is")
    rest = sum(len(one.promised) - len(one.tried) for one in search.rounds)
    notes = (
        f"The threshold is a deviance of {HEAD_START:g} beyond the penalty. Not fitted were {rest} whose score, "
        "the slope of the likelihood, promised less than others, or less than the threshold.",
    )
    return Table("Evidence", header, tuple(rows), notes=notes)


def _predictions(search: PlanarSearch) -> list[Table]:
    """Errors of the heading by horizon, on runs fitted and held out."""
    rows = [
        (word, f"{one.horizon:g}", *(
            number(float(YAW.shown(x)), 3) for x in (one.before, one.after, one.constant_rate, one.constant)
        ))
        for word, outlook in (("fitted", search.outlook(False)), ("held out", search.outlook(True)))
        for one in (outlook.ahead if isinstance(outlook, Outlook) else ())
    ]  # fmt: skip
    header = ("runs", "s ahead", "before", "after", "constant rate", "constant heading")
    return [Table("Heading predicted, error in deg", header, tuple(rows))] if rows else []


def _where_table(where: Where) -> Table | str:
    """Where the gap stands out, the surest stretches first."""
    if not where.regions:
        return "The error depends on no variable beyond chance."
    rows = [
        (
            one.variable, f"{one.low:.3g} to {one.high:.3g} {one.unit}", one.seen_in,
            number(one.gap, 3), number(one.p_value, 2), str(len(one.runs)),
        )
        for one in where.regions[:MOST_REGIONS]
    ]  # fmt: skip
    header = ("variable", "from", "seen in", "heading off by [deg]", "p", "runs")
    notes = (
        "Seen in the heading as predicted, or in the force or moment that the filter needed beside the model; p by "
        "turning the sign of stretches of runs.",
    )
    return Table("Where", header, tuple(rows), notes=notes)


@sections.register
def _(result: PlanarDiagnosis) -> Sections:
    search = result.search
    printed = tables(search)
    figures = {"why": partial(why_figure, search)}
    if search.where is not None:
        figures = {
            "where": partial(where_figure, search, search.where),
            **figures,
            "before_after": partial(before_after_figure, search),
        }
    page = [*printed, *([_where_table(search.where)] if search.where else [])]
    blocks = [part if isinstance(part, str) else part.to_markdown() for part in page]
    files: dict[str, Content] = {
        "diagnosis.json": result.to_json(),
        "extended_model.json": result.extended_model(),
        "diagnosis.md": "\n\n".join(["# Diagnosis", *blocks, *(f"![{name}]({name}.png)" for name in figures)]) + "\n",
    }
    rows = [
        {"effect": contender.candidate.name, "parameter": name, **numbers(estimate)}
        for contender in search.named
        for name, estimate in result.estimates_of(contender).items()
    ]
    return Sections(printed, files, figures, (*files, *(f"{name}.png" for name in figures)), rows)
