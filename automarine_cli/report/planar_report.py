"""The tables and sentences of `fit-planar`."""

from collections.abc import Iterator

from automarine_cli.fits.planar_fit import PlanarFit
from automarine_cli.report.tables import Table, number

WORDS = {
    "surge.m_u": "mass with added mass, ahead", "sway.m_v": "mass with added mass, abeam",
    "yaw.I_r": "inertia with added inertia", "planar.m_vr": "inertia that couples sway and yaw",
    "surge.X_u": "linear drag ahead", "surge.X_uu": "quadratic drag ahead", "sway.Y_v": "linear drag abeam",
    "sway.Y_vv": "quadratic drag abeam", "yaw.k_r": "linear yaw drag", "yaw.k_rr": "quadratic yaw drag",
    "sway.Y_r": "sway force against turning", "yaw.N_v": "yaw moment against drifting",
    "yaw.N_ur": "yaw drag that grows with the speed ahead", "sway.Y_uv": "sway drag that grows with the speed ahead",
    "current.north": "water, north", "current.east": "water, east",
}  # fmt: skip


def tables(fit: PlanarFit) -> tuple[Table, Table]:
    """Parameters, then the structures that were tried."""
    return parameter_table(fit), structure_table(fit)


def parameter_table(fit: PlanarFit) -> Table:
    """One row a parameter that was identified."""
    rows = [
        (
            name, WORDS.get(name, ""), number(one.value, 4), number(one.stderr, 2),
            f"{number(one.ci95[0], 4)} to {number(one.ci95[1], 4)}", one.unit,
        )
        for name, one in fit.estimates.items()
    ]  # fmt: skip
    header = ("parameter", "meaning", "value", "standard error", "95 % interval", "unit")
    notes = (
        "Masses and drags are positive where they resist, as in m_u u' = X - X_u u; Fossen's derivatives of these "
        "names are their negatives.",
    )
    return Table("Surge, sway and yaw together", header, tuple(rows), notes=notes)


def structure_table(fit: PlanarFit) -> Table:
    """One row a structure that was tried, the best first."""
    rows = [
        (
            str(one.structure), str(len(one.found.model.free)), number(one.found.log_likelihood, 7),
            number(one.found.criterion - fit.found.criterion, 4),
        )
        for one in fit.tried
    ]  # fmt: skip
    return Table(
        "Structures", ("structure", "parameters", "log likelihood", "BIC less the best"), tuple(rows)
    )


def sentences(fit: PlanarFit) -> Iterator[str]:
    """Structure and why, assumptions, sensors, warnings."""
    yield f"Structure: {fit.structure}. {fit.because}"
    yield from (f"Assumed: {one}." for one in fit.assumptions)
    noises = fit.found.noises
    told = [f"{name} ({number(noises[name], 3)})" if name in noises else name for name in fit.seen.channels]
    yield f"Sensors that count (noise in rad, m and seconds): {', '.join(told)}."
    yield from fit.warnings
