"""What a planar diagnosis shows: sentences, tables, the page for a person and its figures."""

from collections.abc import Sequence

from automarine_cli import effects
from automarine_cli.diagnosis.outlook import Outlook
from automarine_cli.diagnosis.planar import ERRORS, HEAD_START, PlanarSearch
from automarine_cli.diagnosis.planar_candidates import Candidate
from automarine_cli.diagnosis.verdict import UNEXPLAINED, stretch
from automarine_cli.diagnosis.where import Where
from automarine_cli.dofs import YAW
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.figures.planar_diagnosis import (
    before_after_figure,
    in_words,
    label,
    where_figure,
    why_figure,
)
from automarine_cli.report.tables import MISSING, Table, number

SAYS = {
    "cross-coupling": "One motion drives another",
    "munk-moment": "Sway takes more water along than surge, which turns a drifting hull",
    "current": "The water moves",
}
SPLIT_BY = {
    "Y_r": "turns on the spot under a moment alone",
    "N_v": "thrust abeam from rest, without way on",
    "N_ur": "turns under one moment at several speeds ahead",
    "Y_uv": "thrust abeam at several speeds ahead",
    "m_vr": "short pulses of thrust abeam from rest",
    "m_v": "oblique courses at several speeds: its moment grows with surge times sway",
    "north": "drifting without thrust",
}
"""Runs that tell one coupling from others, by the first letter that it adds."""
MOST_REGIONS = 8


def says(one: Candidate) -> str:
    """What an effect is, and by which parameters."""
    what = SAYS.get(one.name) or effects.get(one.name).card(YAW).says.rstrip(".")
    return f"{what} ({', '.join(one.added)})."


def split_by(one: Candidate) -> str:
    """The run that would tell it from what is named."""
    run = SPLIT_BY.get(one.added[0].rpartition(".")[2]) or effects.get(one.name).card(YAW).separated_by
    return f"{run[:1].upper()}{run[1:]}."


def why(search: PlanarSearch) -> str:
    """Why effects are suspected only, or where the gap stands out that no effect explains; empty where neither is."""
    names = [label(one.candidate) for one in search.suspected]
    if names:
        asks = f"The fitted runs ask for {' or '.join(names)}"
        return f"{asks}, but the likelihood of held-out runs does not improve with it."
    if search.verdict != UNEXPLAINED or search.where is None:
        return ""
    return f"The error is beyond chance {stretch(search.where.regions[0])}. {_passed_over(search)}"


def _passed_over(search: PlanarSearch) -> str:
    """Why the candidate that gains most was not taken."""
    most = search.passed_over
    if most is None:
        return "No candidate gains more than chance."
    return (
        f"The best candidate, {label(most.candidate)}, gains {most.surplus:.0f} in deviance, but not in the mean of "
        f"runs by {ERRORS:g} standard errors."
    )


def verdict_sentence(search: PlanarSearch) -> str:
    """The verdict in one sentence with its numbers."""
    if search.verdict == "nothing-missing":
        return "Nothing is missing that the runs could show."
    if search.verdict == "unexplained":
        return f"Unexplained. {why(search)}"
    if search.verdict == "suspected":
        return f"Suspected: {in_words(search).removeprefix('suspected ')}. {why(search)}"
    held_out = search.outlook(True)
    judged = held_out and (held_out.judged or held_out.ahead[-1])
    if not judged:
        return f"Named: {in_words(search)}."
    before, after = (f"{YAW.shown(x):.3g}" for x in (judged.before, judged.after))
    return (
        f"Named: {in_words(search)}; on runs held out the heading is predicted {judged.horizon:g} s ahead to {after} "
        f"deg, {before} before."
    )


def tables(search: PlanarSearch) -> list[Table | str]:
    """The verdict, the evidence, the predictions."""
    told: list[Table | str] = [verdict_sentence(search)]
    for one in search.steps:
        if one.best is not None:
            told.append(f"{one.best.candidate.name}: {says(one.best.candidate)}")
        told += [f"Cannot be excluded: {label(rival.candidate)}: {split_by(rival.candidate)}" for rival in one.rivals]
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
            rows.append((str(i), label(each.candidate), number(each.surplus, 4), number(each.held_out, 4), word))
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
            number(float(YAW.shown(one.gap)), 3), number(one.p_value, 2), str(len(one.runs)),
        )
        for one in where.regions[:MOST_REGIONS]
    ]  # fmt: skip
    header = ("variable", "from", "seen in", "heading off by [deg]", "p", "runs")
    notes = (
        "Seen in the heading as predicted, or in the force or moment that the filter needed beside the model; p by "
        "turning the sign of stretches of runs.",
    )
    return Table("Where", header, tuple(rows), notes=notes)


def write(folder: ResultFolder, search: PlanarSearch, where: Where | None, formats: Sequence[str] = ("png",)) -> None:
    """The page, then each figure in each of the formats."""
    told = [*tables(search), *([_where_table(where)] if where else [])]
    drawings = {
        **({"where": lambda: where_figure(search, where)} if where else {}),
        "why": lambda: why_figure(search),
        **({"before_after": lambda: before_after_figure(search)} if where else {}),
    }
    pictures = [f"![{name}]({name}.png)" for name in drawings if "png" in formats]
    text = [one if isinstance(one, str) else one.to_markdown() for one in told]
    folder.write("diagnosis.md", "\n\n".join(["# Diagnosis", *text, *pictures]) + "\n")
    write_figures(folder, drawings, formats)
