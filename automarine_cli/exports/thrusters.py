"""Thruster maps for simulators: constants of the square law, dead-band laws, tables.

Ours: F = a max(min(|n|, n_sat) - n_0, 0)^p, forward and backward apart. Theirs:
- constants: F = k_pos n |n| ahead, k_neg n |n| astern, n within n_min and n_max, T_n n' = n_c - n: MSS,
  CRAFT/USV/models/otter.m, and its Python twin;
- stonefish-deadband: F = forward (n|n| - upper) above, reverse (n|n| - lower) below, else 0, and stonefish-table,
  straight lines between points (both: stonefish.readthedocs.io, Actuators, Thruster; DeadbandThrust in
  Library/include/actuators);
- uuv-bessa: F = rotorConstantR (n|n| - deltaR) above, rotorConstantL (n|n| - deltaL) below, else 0, and uuv-table,
  LinearInterp (uuv_gazebo_plugins/src/ThrusterConversionFcn.cc; FirstOrder in Dynamics.cc);
- gz-thruster: F = thrust_coefficient fluid_density propeller_diameter^4 n |n|, one coefficient for both directions
  (gazebosim.org/api/sim/9, class Thruster; with use_angvel_cmd the command is n).
"""

from collections.abc import Callable, Mapping

import numpy as np

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import (
    THRUSTER_MAP,
    MapSubject,
    Target,
    Written,
    commented,
    head,
    number,
    row,
    xml_comment,
)
from automarine_cli.exports.thruster_laws import (
    CLOSE,
    both_sides,
    force_of,
    largest_signal,
    square_side,
    table,
    top,
    worst,
)
from automarine_cli.quantities import Floats

TABLES = {
    "constants": "stonefish-table or uuv-table",
    "stonefish-deadband": "stonefish-table",
    "uuv-bessa": "uuv-table",
}
"""The form that follows any map, for those that do not."""
DENSITY, DIAMETER = 1000.0, 0.1  # of Gazebo's law; only their product with the coefficient counts
AHEAD = "Thrust is positive ahead, in both frames alike."
NAMES = "Names of links, joints and actuators are placeholders: merge with your model."


def write(subject: MapSubject) -> Written:
    """The text of the form asked for. Raises SettingError where the form cannot follow the map closely enough."""
    n_max = largest_signal(subject)
    unit = f" ({subject.map.n_unit})" if subject.map.n_unit else ""
    notes = [AHEAD, f"n is the control signal in the logs' unit{unit}, up to {n_max:.4g}."]
    for name, curve in (("forward", subject.map.forward), ("backward", subject.map.backward)):
        if curve is None:
            _refuse_unmeasured(subject, name)
            notes.append(f"Left out: {name} was never measured and gives nothing here.")
        elif curve.n_0 >= n_max:
            raise SettingError(
                f"{subject.origin.file}: {name} gives nothing up to n = {n_max:.4g}, which is within its dead band of "
                f"{curve.n_0:.4g}; give a larger --n-max"
            )
    if subject.form != "constants":
        notes.append(NAMES)
    if subject.form.endswith("table"):
        n, force = table(subject.map, n_max)
        return _text(subject, notes, {"n": row(n), "force": row(force)}, n_max)
    if subject.form == "gz-thruster":
        return _gz(subject, notes, n_max)
    bands = subject.form != "constants"
    ahead, astern = (
        square_side(curve, n_max, with_dead_band=bands) for curve in (subject.map.forward, subject.map.backward)
    )
    notes += _error(subject, lambda n: ahead.thrust(np.maximum(n, 0)) - astern.thrust(np.maximum(-n, 0)), n_max)
    values = {
        "k_pos": number(ahead.k), "k_neg": number(astern.k), "upper": number(ahead.d), "lower": number(-astern.d),
        "n_pos": number(ahead.limit), "n_neg": number(-astern.limit),
    }  # fmt: skip
    return _text(subject, notes, values, max(ahead.limit, astern.limit))


def _refuse_unmeasured(subject: MapSubject, name: str) -> None:
    if not subject.settings.allow_partial:
        raise SettingError(
            f"{subject.origin.file}: {name} was never measured; give --allow-partial for a file in which the thruster "
            f"gives nothing {name}, or fit the map from a bollard test that pulls both ways"
        )


def _error(subject: MapSubject, law: Callable[[Floats], Floats], n_max: float) -> list[str]:
    """The note on how far the law is from the map; raises SettingError where that is too far and was not allowed."""
    off, full = worst(subject.map, law, n_max), top(subject.map, n_max)
    if off < CLOSE * full:
        return []
    wrong = f"wrong by up to {off:.2g} N ({100 * off / full:.2g} % of {full:.3g} N)"
    if not subject.settings.allow_partial:
        raise SettingError(
            f"{subject.origin.file}: {subject.form} cannot follow a map of the form {subject.map.form}: its thrust "
            f"would be {wrong}; give --form {TABLES[subject.form]}, which follows any map, or --allow-partial"
        )
    return [f"Warning: the thrust of this file is {wrong}, for the map has the form {subject.map.form}."]


def _gz(subject: MapSubject, notes: list[str], n_max: float) -> Written:
    """Gazebo's law has one coefficient; with two it would need another plugin."""
    if subject.settings.lag is not None:
        raise SettingError("--lag means nothing to gz-thruster, whose thrust follows the command at once; leave it out")
    side = both_sides(subject, n_max)
    law: Callable[[Floats], Floats] = lambda n: np.sign(n) * side.thrust(np.abs(n))  # noqa: E731
    off, full = worst(subject.map, law, n_max), top(subject.map, n_max)
    wrong = f"{off:.2g} N ({100 * off / full:.2g} % of {full:.3g} N)"
    if off >= CLOSE * full:
        if not subject.settings.symmetrise:
            ahead, astern = force_of(subject.map, np.array([n_max, -n_max]))
            raise SettingError(
                f"{subject.origin.file}: gz-thruster has one coefficient for both directions and no other law than "
                f"the square, but at n = {n_max:.4g} this thruster gives {ahead:.3g} N ahead and {-astern:.3g} N "
                f"astern: its thrust would be wrong by up to {wrong}; give --symmetrise to take that"
            )
        notes.append(f"Warning: symmetrised; the thrust of this file is wrong by up to {wrong}.")
    coefficient = side.k / (DENSITY * DIAMETER**4)
    return _text(subject, notes, {"coefficient": number(coefficient)}, n_max)


def _text(subject: MapSubject, notes: list[str], values: Mapping[str, str], n_max: float) -> Written:
    equation, body = BODIES[subject.form]
    lag = subject.settings.lag
    own = dict(values) | {"limit": number(n_max), "minus": number(-n_max)}
    own["density"], own["diameter"] = number(DENSITY), number(DIAMETER)
    own["uuv_lag"] = (
        "<type>ZeroOrder</type>"
        if lag is None
        else f"<type>FirstOrder</type>\n        <timeConstant>{number(lag)}</timeConstant>"
    )
    own["fish_lag"] = (
        '<rotor_dynamics type="zero_order"/>'
        if lag is None
        else f'<rotor_dynamics type="first_order">\n    <time_constant value="{number(lag)}"/>\n  </rotor_dynamics>'
    )
    own["T_n"] = "" if lag is None else f"T_n = {number(lag)}  # s\n"
    lines = head(subject, equation, notes)
    if subject.form == "constants":
        return Written(commented(lines, "#") + body.format(**own), tuple(notes))
    return Written(f'<?xml version="1.0"?>\n{xml_comment(lines)}{body.format(**own)}', tuple(notes))


_CONSTANTS = """k_pos = {k_pos}  # N per n^2, ahead
k_neg = {k_neg}  # N per n^2, astern
n_max = {n_pos}
n_min = {n_neg}
{T_n}"""
_FISH = """<actuator name="thruster" type="thruster">
  <specs max_setpoint="{limit}" inverted_setpoint="false"/>
  {fish_lag}
  <thrust_model type="TYPE">
MODEL
  </thrust_model>
</actuator>
"""
_BAND = """    <thrust_coeff forward="{k_pos}" reverse="{k_neg}"/>
    <deadband lower="{lower}" upper="{upper}"/>"""
_POINTS = """    <input value="{n}"/>
    <output value="{force}"/>"""
_UUV = """<robot name="vehicle">
  <gazebo>
    <plugin name="thruster_0_plugin" filename="libuuv_thruster_ros_plugin.so">
      <linkName>thruster_0</linkName>
      <jointName>thruster_0_joint</jointName>
      <thrusterID>0</thrusterID>
      <gain>1</gain>
      <clampMax>MAX</clampMax>
      <clampMin>MIN</clampMin>
      <dynamics>
        {uuv_lag}
      </dynamics>
      <conversion>
MODEL
      </conversion>
    </plugin>
  </gazebo>
</robot>
"""
_BESSA = """        <type>Bessa</type>
        <rotorConstantL>{k_neg}</rotorConstantL>
        <rotorConstantR>{k_pos}</rotorConstantR>
        <deltaL>{lower}</deltaL>
        <deltaR>{upper}</deltaR>"""
_INTERP = """        <type>LinearInterp</type>
        <inputValues>{n}</inputValues>
        <outputValues>{force}</outputValues>"""
_GZ = """<sdf version="1.10">
  <model name="vehicle">
    <plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">
      <joint_name>propeller_joint</joint_name>
      <use_angvel_cmd>true</use_angvel_cmd>
      <velocity_control>true</velocity_control>
      <fluid_density>{density}</fluid_density>
      <propeller_diameter>{diameter}</propeller_diameter>
      <thrust_coefficient>{coefficient}</thrust_coefficient>
      <max_thrust_cmd>{limit}</max_thrust_cmd>
      <min_thrust_cmd>{minus}</min_thrust_cmd>
    </plugin>
  </model>
</sdf>
"""
SQUARE = "F = k_pos n |n| ahead, k_neg n |n| astern"
BODIES = {
    "constants": (SQUARE, _CONSTANTS),
    "stonefish-deadband": (
        "F = forward (n |n| - upper) above upper, reverse (n |n| - lower) below lower",
        _FISH.replace("TYPE", "deadband").replace("MODEL", _BAND),
    ),
    "stonefish-table": (
        "F by straight lines between the points",
        _FISH.replace("TYPE", "linear_interpolation").replace("MODEL", _POINTS),
    ),
    "uuv-bessa": (
        "F = rotorConstantR (n |n| - deltaR) above deltaR, rotorConstantL (n |n| - deltaL) below deltaL",
        _UUV.replace("MODEL", _BESSA).replace("MAX", "{n_pos}").replace("MIN", "{n_neg}"),
    ),
    "uuv-table": (
        "F by straight lines between the points",
        _UUV.replace("MODEL", _INTERP).replace("MAX", "{limit}").replace("MIN", "{minus}"),
    ),
    "gz-thruster": ("F = thrust_coefficient fluid_density propeller_diameter^4 n |n|", _GZ),
}

TARGET = Target(
    name="thrusters",
    says="a thruster map: constants, Stonefish, uuv_simulator or Gazebo",
    source="see each form's own: stonefish.readthedocs.io, gazebosim.org/api/sim/9, uuv_gazebo_plugins",
    forms={form: ".py" if form == "constants" else ".sdf" if form == "gz-thruster" else ".xml" for form in BODIES},
    carries=frozenset(),
    si=False,
    uses=frozenset({"symmetrise", "n_max", "lag"}),
    takes=THRUSTER_MAP,
    write=write,
)
