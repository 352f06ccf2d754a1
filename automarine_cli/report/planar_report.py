"""The tables and sentences of `fit-planar`."""

from collections.abc import Iterator
from functools import partial

from automarine_cli.dofs import YAW
from automarine_cli.fits.planar_fit import HEADING, UNITS, PlanarFit, PlanarUse, shown
from automarine_cli.models.store import units
from automarine_cli.report.figures.runs import driven_runs_figure
from automarine_cli.report.sections import Sections, document, forms_of, numbers, sections
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


@sections.register
def _(fit: PlanarFit) -> Sections:
    use = () if fit.use is None else fit.use.sentences
    first = (*use[:1], *(f"Warning: {line}" for line in fit.disturbed), *use[1:], *filter(None, [fit.choice.because]))
    rest = list(sentences(fit))
    tables = [parameter_table(fit), *([] if fit.use is None else [prediction_table(fit.use)]), structure_table(fit)]
    rows = [{"parameter": name, **numbers(estimate)} for name, estimate in fit.estimates.items()]
    files = {"planar_model.json": fit.to_json()} | forms_of("planar", *tables)
    files |= {"planar.csv": Table.of("", rows).to_csv(), "planar.md": document(*tables, *first, *rest)}
    drawings = {} if fit.use is None else {"planar_runs": partial(driven_runs_figure, fit, fit.use)}
    listed = "planar_model.json", "planar (.csv, .md, .tex)", "planar_runs.png"
    return Sections([*first, *tables, *rest], files, drawings, listed, rows)


def sentences(fit: PlanarFit) -> Iterator[str]:
    yield f"Structure: {fit.structure}. {fit.because}"
    yield from fit.prior.sentences(units(fit.model), fit.model.parameter_names)
    yield from (f"Assumed: {assumption}." for assumption in fit.structure.assumptions)
    noises = fit.found.noises
    channels = [f"{name} ({number(noises[name], 3)})" if name in noises else name for name in fit.observed.channels]
    yield f"Sensors that count (noise in rad, m and seconds): {', '.join(channels)}."
    said = (*(() if fit.use is None else fit.use.sentences), *fit.disturbed)
    yield from (warning for warning in fit.warnings if warning not in said)


def prediction_table(use: PlanarUse) -> Table:
    """One row a horizon and quantity: errors of the model beside those of whoever expects no change."""
    alone = {ahead.horizon: number(float(YAW.shown(ahead.error)), 3) for ahead in use.yaw_only}
    rows = []
    for name, horizons in use.worth.items():
        for ahead in horizons:
            sizes = {"model": ahead.error, "constant rate": ahead.constant_rate, "constant": ahead.constant}
            rows.append({
                "of": f"{name}, {UNITS[name]}", "s ahead": f"{ahead.horizon:g}",
                **{word: number(shown(name, size), 3) for word, size in sizes.items()},
                "yaw alone": alone.get(ahead.horizon, MISSING) if name == HEADING else MISSING,
                "predictions": ahead.count,
            })  # fmt: skip
    whose = "Each run is predicted by the parameters that the other runs give" if use.runs > 1 else "Of the run fitted"
    return Table.of("Predictions", rows, [
        f"Root mean square errors. {whose}, from its filtered state, which knows the readings until then, by the "
        "commands as they were logged. Yaw alone: the best of models 1 to 3 of these runs' yaw.",
    ])  # fmt: skip


def parameter_table(fit: PlanarFit) -> Table:
    """Lay out the parameters that were identified."""
    rows = [
        {"parameter": name, "meaning": WORDS.get(name, ""), "value [95 % interval]": estimate, "unit": estimate.unit}
        for name, estimate in fit.estimates.items()
    ]
    return Table.of("Surge, sway and yaw together", rows, [
        "Masses and drags are positive where they resist, as in m_u u' = X - X_u u; Fossen's derivatives of these "
        "names are their negatives.",
    ])  # fmt: skip


def structure_table(fit: PlanarFit) -> Table:
    """Lay out the structures that were tried, the best first."""
    best = fit.tried[0].estimated.criterion
    return Table.of("Structures", [
        {"structure": str(t.structure), "parameters": len(t.estimated.model.free),
         "log likelihood": number(t.estimated.log_likelihood, 7), "BIC less the best": t.estimated.criterion - best}
        for t in fit.tried
    ])  # fmt: skip
