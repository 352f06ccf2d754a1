"""The tables and sentences of `fit-planar`."""

from collections.abc import Iterator
from functools import partial

from automarine_cli.dofs import YAW
from automarine_cli.estimate import Estimate
from automarine_cli.fits.planar_fit import HEADING, UNITS, PlanarFit, PlanarUse, shown
from automarine_cli.models.planar_store import units
from automarine_cli.report.figures.planar import planar_runs_figure
from automarine_cli.report.sections import Content, Sections, numbers, sections
from automarine_cli.report.tables import MISSING, Table, number

WORDS = {
    "surge.m_u": "mass with added mass, ahead", "sway.m_v": "mass with added mass, abeam",
    "yaw.I_r": "inertia with added inertia", "planar.m_vr": "inertia that couples sway and yaw",
    "surge.X_u": "linear drag ahead", "surge.X_uu": "quadratic drag ahead", "sway.Y_v": "linear drag abeam",
    "sway.Y_vv": "quadratic drag abeam", "yaw.k_r": "linear yaw drag", "yaw.k_rr": "quadratic yaw drag",
    "sway.Y_r": "sway force against turning", "yaw.N_v": "yaw moment against drifting",
    "yaw.N_ur": "yaw drag that grows with the speed ahead", "sway.Y_uv": "sway drag that grows with the speed ahead",
    "current.north": "water, north", "current.east": "water, east",
}  # fmt: skip


def tables(fit: PlanarFit) -> tuple[Table, ...]:
    """Parameters, predictions where they were judged, then the structures that were tried."""
    predictions = () if fit.use is None else (prediction_table(fit.use),)
    return (parameter_table(fit), *predictions, structure_table(fit))


def prediction_table(use: PlanarUse) -> Table:
    """One row a horizon and quantity: errors of the model beside those of whoever expects no change."""
    alone = {one.horizon: number(float(YAW.shown(one.error)), 3) for one in use.yaw_only}
    rows = [
        (
            f"{name}, {UNITS[name]}", f"{one.horizon:g}",
            *(number(shown(name, x), 3) for x in (one.error, one.constant_rate, one.constant)),
            alone.get(one.horizon, MISSING) if name == HEADING else MISSING, str(one.count),
        )
        for name, each in use.forecasts.worth.items()
        for one in each
    ]  # fmt: skip
    header = ("of", "s ahead", "model", "constant rate", "constant", "yaw alone", "predictions")
    whose = (
        "Each run is predicted by the parameters that the other runs give" if use.runs > 1 else "Of the run of the fit"
    )
    notes = (
        f"Root mean square errors. {whose}, from its filtered state, which knows the readings until then, by the "
        "commands as they were logged. Yaw alone: the best of models 1 to 3 of these runs' yaw.",
    )
    return Table("Predictions", header, tuple(rows), notes=notes)


def parameter_table(fit: PlanarFit) -> Table:
    """One row a parameter that was identified."""
    rows = [
        (
            name, WORDS.get(name, ""), number(one.value, 4), *_spread(one), one.unit,
        )
        for name, one in fit.estimates.items()
    ]  # fmt: skip
    header = ("parameter", "meaning", "value", "standard error", "95 % interval", "unit")
    notes = (
        "Masses and drags are positive where they resist, as in m_u u' = X - X_u u; Fossen's derivatives of these "
        "names are their negatives.",
    )
    return Table("Surge, sway and yaw together", header, tuple(rows), notes=notes)


def _spread(one: Estimate) -> tuple[str, str]:
    """The standard error and the interval, or why there are none."""
    if one.at_bound:
        return MISSING, "at its bound"
    if one.known and not one.stderr:
        return MISSING, "known"
    return number(one.stderr, 2), f"{number(one.ci95[0], 4)} to {number(one.ci95[1], 4)}{' (known)' * one.known}"


def structure_table(fit: PlanarFit) -> Table:
    """One row a structure that was tried, the best first."""
    rows = [
        (
            str(one.structure), str(len(one.found.model.free)), number(one.found.log_likelihood, 7),
            number(one.criterion - fit.tried[0].criterion, 4),
        )
        for one in fit.tried
    ]  # fmt: skip
    return Table("Structures", ("structure", "parameters", "log likelihood", "BIC less the best"), tuple(rows))


def first_sentences(fit: PlanarFit) -> tuple[str, ...]:
    """Of what use it is, a disturbance as large as the commands, and how it was fitted."""
    use = () if fit.use is None else fit.use.sentences
    return (*use[:1], *(f"Warning: {one}" for one in fit.disturbed), *use[1:], *filter(None, [fit.choice.because]))


def sentences(fit: PlanarFit) -> Iterator[str]:
    """Of what use it is, structure and why, assumptions, sensors, warnings."""
    yield from first_sentences(fit)
    yield f"Structure: {fit.structure}. {fit.because}"
    yield from fit.known.sentences(units(fit.model), fit.model.parameter_names)
    yield from (f"Assumed: {one}." for one in fit.assumptions)
    noises = fit.found.noises
    told = [f"{name} ({number(noises[name], 3)})" if name in noises else name for name in fit.seen.channels]
    yield f"Sensors that count (noise in rad, m and seconds): {', '.join(told)}."
    said = (*(() if fit.use is None else fit.use.sentences), *fit.disturbed)
    yield from (one for one in fit.warnings if one not in said)


@sections.register
def _(fit: PlanarFit) -> Sections:
    first, rest, every = first_sentences(fit), list(sentences(fit)), tables(fit)
    files: dict[str, Content] = {
        "planar_model.json": fit.to_json(),
        "planar.csv": every[0].to_csv(),
        "planar.md": "\n".join([*(table.to_markdown() for table in every), "".join(f"{line}\n" for line in rest)]),
        "planar.tex": "\n".join(table.to_latex() for table in every),
    }
    return Sections(
        [*first, *every, *(line for line in rest if line not in first)],
        files,
        {} if fit.use is None else {"planar_runs": partial(planar_runs_figure, fit.runs, fit.use)},
        ("planar_model.json", "planar (.csv, .md, .tex)", "planar_runs.png"),
        [{"parameter": name, **numbers(estimate)} for name, estimate in fit.estimates.items()],
    )
