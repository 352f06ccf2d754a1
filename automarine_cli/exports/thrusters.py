"""Thruster maps for simulators: constants of the square law, or a table.

Ours: F = a max(min(|n|, n_sat) - n_0, 0)^p or a monotone spline, forward and backward apart. Theirs:
- constants: F = k_pos n |n| ahead, k_neg n |n| astern, n within n_min and n_max, T_n n' = n_c - n: MSS,
  CRAFT/USV/models/otter.m, and its Python twin;
- uuv-table: straight lines between points, LinearInterp (uuv_gazebo_plugins/src/ThrusterConversionFcn.cc; FirstOrder
  in Dynamics.cc);
- gz-thruster: F = thrust_coefficient fluid_density propeller_diameter^4 n |n|, one coefficient for both directions
  (gazebosim.org/api/sim/9, class Thruster; with use_angvel_cmd the command is n).
"""

from collections.abc import Callable, Mapping

import numpy as np

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import MapSubject, Target, Written, comment, filled, head, number, row
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.curves import Curve, PowerCurve
from automarine_cli.thrusters.map import ThrusterMap, thrust_both_ways

GRID = 2001  # control signals at which a law is compared with the map
CLOSE = 1e-3  # of the full scale: nearer than any bollard test tells
MAX_POINTS = 1025  # of a table, in one direction
DENSITY, DIAMETER = 1000.0, 0.1  # of Gazebo's law; only their product with the coefficient counts
SIGN_NOTE = "Thrust is positive ahead, in both frames alike."
NAMES = "Names of links, joints and actuators are placeholders: merge with your model."


def write(subject: MapSubject) -> Written:
    """The text of the form asked for. Raises SettingError where the form cannot follow the map closely enough."""
    n_max = largest_signal(subject)
    unit = f" ({subject.map.n_unit})" if subject.map.n_unit else ""
    notes = [SIGN_NOTE, f"n is the control signal in the logs' unit{unit}, up to {n_max:.4g}."]
    for name, curve in (("forward", subject.map.forward), ("backward", subject.map.backward)):
        if curve is None:
            if not subject.settings.allow_partial:
                raise SettingError(
                    f"{subject.origin.file}: {name} was never measured; give --allow-partial for a file in which the "
                    f"thruster gives nothing {name}, or fit the map from a bollard test that pulls both ways"
                )
            notes.append(f"Left out: {name} was never measured and gives nothing here.")
        elif curve.n_0 >= n_max:
            within = f"which is within its dead band of {curve.n_0:.4g}; give a larger --n-max"
            raise SettingError(f"{subject.origin.file}: {name} gives nothing up to n = {n_max:.4g}, {within}")
    if subject.form != "constants":
        notes.append(NAMES)
    if subject.form == "uuv-table":
        n, force = table(subject.map, n_max)
        return _text(subject, notes, {"n": row(n), "force": row(force)}, n_max)
    gazebo = subject.form == "gz-thruster"
    if gazebo and subject.settings.lag is not None:
        raise SettingError("--lag means nothing to gz-thruster, whose thrust follows the command at once; leave it out")
    curves = (subject.map.forward, subject.map.backward)
    ahead, astern = (nearest_square(curve, n_max) for curve in curves)
    if gazebo:
        slopes = [law.a for law, curve in zip((ahead, astern), curves) if curve]
        ahead = astern = PowerCurve(float(np.mean(slopes)), n_sat=n_max)
    notes += _error(subject, lambda n: thrust_both_ways(ahead, astern, n), n_max)
    limits = [law.n_sat or n_max for law in (ahead, astern)]
    values = {
        "k_pos": number(ahead.a), "k_neg": number(astern.a), "n_pos": number(limits[0]), "n_neg": number(-limits[1]),
        "coefficient": number(ahead.a / (DENSITY * DIAMETER**4)),
    }  # fmt: skip
    return _text(subject, notes, values, max(limits))


def _error(subject: MapSubject, law: Callable[[Floats], Floats], n_max: float) -> list[str]:
    """The note on how far the law is from the map; raises SettingError where that is too far and was not allowed."""
    off, full = deviation(subject.map, law, n_max)
    if off < CLOSE * full:
        return []
    wrong = f"{off:.2g} N ({100 * off / full:.2g} % of {full:.3g} N)"
    why, remedy = f"cannot follow a map of the form {subject.map.form}", "--allow-partial, or --form uuv-table"
    allowed = subject.settings.allow_partial
    if subject.form == "gz-thruster":
        why, remedy = "has one coefficient for both directions and no law but the square", "--symmetrise to take that"
        allowed = subject.settings.symmetrise
    if not allowed:
        wrong = f"its thrust would be wrong by up to {wrong}"
        raise SettingError(f"{subject.origin.file}: {subject.form} {why}: {wrong}; give {remedy}")
    return [f"Warning: the thrust of this file is wrong by up to {wrong}: {subject.form} {why}."]


def _text(subject: MapSubject, notes: list[str], values: Mapping[str, str], n_max: float) -> Written:
    lag, uuv, constant = subject.settings.lag, "<type>ZeroOrder</type>", ""
    if lag is not None:
        uuv = f"<type>FirstOrder</type>\n        <timeConstant>{number(lag)}</timeConstant>"
        constant = f"T_n = {number(lag)}  # s\n"
    fields = {
        **values, "limit": number(n_max), "minus": number(-n_max), "density": number(DENSITY),
        "diameter": number(DIAMETER), "uuv_lag": uuv, "T_n": constant,
        "head": comment(head(subject, FORM_LAWS[subject.form], notes), "#" if subject.form == "constants" else ""),
    }  # fmt: skip
    return Written(filled(f"thrusters_{subject.form}", fields), tuple(notes))


def largest_signal(subject: MapSubject) -> float:
    """The largest control signal: of the settings, else where the stronger direction reaches the full scale measured,
    within what was measured.

    Raises SettingError without either."""
    if subject.settings.n_max is not None:
        return subject.settings.n_max
    curves = [curve for curve in (subject.map.forward, subject.map.backward) if curve is not None]
    if subject.full_scale is None or subject.full_scale <= 0:
        raise SettingError(f"{subject.origin.file} does not tell how far the thruster was driven; give --n-max")
    measured = max(map(abs, subject.map.n_range)) if subject.map.n_range else np.inf
    return min(measured, *(min(curve.signal(subject.full_scale), curve.n_sat or np.inf) for curve in curves))


def nearest_square(curve: Curve | None, n_max: float) -> PowerCurve:
    """Return the square law nearest to a curve by least squares on the thrust, up to where that ends."""
    if curve is None:
        return PowerCurve(0.0, n_sat=n_max)
    limit = min(curve.n_sat or n_max, n_max)
    n = np.linspace(0.0, limit, GRID)
    return PowerCurve(float(n**2 @ curve.thrust(n) / (n**2 @ n**2)), n_sat=limit)


def table(map_: ThrusterMap, n_max: float) -> tuple[Floats, Floats]:
    """Control signals and thrusts between which straight lines follow the map to CLOSE; nothing beyond n_max."""
    points = 9
    while True:
        backward, forward = (_knots(curve, n_max, points) for curve in (map_.backward, map_.forward))
        n = np.concatenate([-backward[::-1], forward[1:]])
        force = thrust_both_ways(map_.forward, map_.backward, n, unmeasured=0.0)
        off, full = deviation(map_, lambda signals: np.interp(signals, n, force), n_max)  # noqa: B023
        if points >= MAX_POINTS or off < CLOSE * full:
            return n, force
        points = 2 * points - 1


def _knots(curve: Curve | None, n_max: float, points: int) -> Floats:
    """Control signals from 0 to n_max, one at each kink of the curve, closer together where it begins."""
    if curve is None:
        return np.array([0.0, n_max])
    limit = min(curve.n_sat or n_max, n_max)
    rise = curve.n_0 + (limit - curve.n_0) * np.linspace(0.0, 1.0, points) ** 1.5
    return np.unique([float(number(n)) for n in (0.0, *rise, n_max)])  # as the file has them: none twice


def deviation(map_: ThrusterMap, law: Callable[[Floats], Floats], n_max: float) -> tuple[float, float]:
    """Return the largest difference [N] of a law from the map within n_max, and the largest thrust of the map."""
    n = np.linspace(-n_max, n_max, GRID)
    force = thrust_both_ways(map_.forward, map_.backward, n, unmeasured=0.0)
    return float(np.max(np.abs(law(n) - force))), float(np.max(np.abs(force)))


FORM_LAWS = {
    "constants": "F = k_pos n |n| ahead, k_neg n |n| astern",
    "uuv-table": "F by straight lines between the points",
    "gz-thruster": "F = thrust_coefficient fluid_density propeller_diameter^4 n |n|",
}

TARGET = Target(
    name="thrusters",
    says="a thruster map: constants, uuv_simulator or Gazebo",
    forms={form: ".py" if form == "constants" else ".sdf" if form == "gz-thruster" else ".xml" for form in FORM_LAWS},
    carries=frozenset(), si=False, uses=frozenset({"symmetrise", "n_max", "lag"}), motions=(), write=write,
)  # fmt: skip
