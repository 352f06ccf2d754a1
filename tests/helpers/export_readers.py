"""Reads exported files back without the library and integrates each target's documented equation.

One reader a target and form: text -> `slope(rate, moment)`, the yaw acceleration in the target's own frame, written
from the target's documentation and not from our exporter.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]
Slope = Callable[[float, float], float]


def number_in(root: ET.Element, path: str, missing: float | None = None) -> float:
    """The number in the element at `path`."""
    text = root.findtext(path)
    if text is None:
        assert missing is not None, f"no {path}"
        return missing
    return float(text)


def gz_sim(text: str) -> Slope:
    """Hydrodynamics system: torque nR r + nRabsR |r| r + nRR r^2 + nDotR r', beside the engine's fluid added mass."""
    root = ET.fromstring(text)
    plugin = root.find(".//plugin[@name='gz::sim::systems::Hydrodynamics']")
    assert plugin is not None and plugin.get("filename") == "gz-sim-hydrodynamics-system"
    link = root.find(f".//link[@name='{plugin.findtext('link_name')}']")
    assert link is not None
    own = {i: number_in(link, f"inertial/inertia/i{i}{i}") for i in "xyz"}
    assert own["z"] <= own["x"] + own["y"] and number_in(link, "inertial/mass") > 0  # or libsdformat refuses it
    fluid = number_in(link, "inertial/fluid_added_mass/rr", 0.0)
    switched_off = plugin.findtext("disable_added_mass") == "true"
    derivative = 0.0 if switched_off else number_in(plugin, "nDotR", 0.0)
    assert fluid == 0.0 or switched_off, "added inertia in two places"
    linear, absolute, square = (number_in(plugin, tag, 0.0) for tag in ("nR", "nRabsR", "nRR"))
    inertia = own["z"] + fluid - derivative
    return lambda r, tau: (tau + linear * r + absolute * abs(r) * r + square * r * r) / inertia


def uuv_urdf(text: str) -> Slope:
    """HMFossen: D = -linear - quadratic |r|, torque -D r - Ma r'."""
    root = ET.fromstring(text)
    model = root.find(".//hydrodynamic_model")
    assert model is not None and model.findtext("type") == "fossen"
    mass = np.array(str(model.findtext("added_mass")).split(), float)
    linear = np.array(str(model.findtext("linear_damping")).split(), float)
    quadratic = np.array(str(model.findtext("quadratic_damping")).split(), float)
    assert mass.shape == (36,) and linear.shape == quadratic.shape == (6,)
    own = root.find("link/inertial/inertia")
    assert own is not None
    return fossen(float(own.attrib["izz"]), mass.reshape(6, 6), linear, quadratic)


def fossen(izz: float, mass: Floats, linear: Floats, quadratic: Floats) -> Slope:
    """The Fossen model about z alone; nothing else may be coupled to it."""
    assert np.count_nonzero(mass) <= 1 and not linear[:5].any() and not quadratic[:5].any()
    damping = lambda r: -linear[5] - quadratic[5] * abs(r)  # noqa: E731
    return lambda r, tau: (tau - damping(r) * r) / (izz + mass[5, 5])


def uuv_controller(text: str) -> Slope:
    """Vehicle of uuv_control_interfaces: D = -linear_damping - quad_damping |r|, (M + Ma) r' = tau - D r."""
    data = yaml.safe_load(text)
    inertial, mass = data["inertial"], np.array(data["Ma"])
    assert isinstance(inertial, dict) and set(inertial) == {"ixx", "iyy", "izz", "ixy", "ixz", "iyz"}
    linear, quadratic = (np.array(data[key], float) for key in ("linear_damping", "quad_damping"))
    assert mass.shape == (6, 6) and linear.shape == quadratic.shape == (6,)
    return fossen(inertial["izz"], mass, linear, quadratic)


def constants_of(text: str) -> dict[str, float]:
    """`name = number` in each line of Python or MATLAB that is no comment."""
    lines = (re.split("[#%;]", line)[0] for line in text.splitlines())
    return {k.strip(): float(v) for k, _, v in (line.partition("=") for line in lines) if v.strip()}


def mss(text: str) -> Slope:
    """(I_z - N_rdot) r' = tau + N_r r + N_rr |r| r + N_rrr r^3 + N_r2 r^2 + N_0."""
    c = {"N_rrr": 0.0, "N_r2": 0.0, "N_0": 0.0} | constants_of(text)
    assert c["N_r"] <= 0 and c["N_rr"] <= 0 and c["N_rdot"] <= 0 < c["I_z"]

    def slope(r: float, tau: float) -> float:
        drag = c["N_r"] * r + c["N_rr"] * abs(r) * r + c["N_rrr"] * r**3 + c["N_r2"] * r * r
        return (tau + drag + c["N_0"]) / (c["I_z"] - c["N_rdot"])

    return slope


def mjcf(text: str) -> Slope:
    """A joint of MuJoCo: (I + armature) r' = force - (d0 + d1 |r| + d2 r^2) r; the force the control, clamped."""
    root = ET.fromstring(text)
    body, option = root.find("worldbody/body"), root.find("option")
    assert body is not None and option is not None and option.get("gravity") == "0 0 0"
    own, joint, motor = body.find("inertial"), body.find("joint"), root.find("actuator/general")
    assert own is not None and joint is not None and motor is not None and motor.get("joint") == joint.get("name")
    inertias = [float(x) for x in own.attrib["diaginertia"].split()]
    inertia = inertias[2] if joint.get("type") == "hinge" else float(own.attrib["mass"])
    drag = [float(x) for x in joint.attrib["damping"].split()]
    total = inertia + float(joint.get("armature", "0"))
    return lambda r, tau: (tau - (drag[0] + drag[1] * abs(r) + drag[2] * r * r) * r) / total


READERS: dict[tuple[str, str], Callable[[str], Slope]] = {
    ("gz-sim", "fluid-added-mass"): gz_sim,
    ("gz-sim", "added-mass-derivative"): gz_sim,
    ("uuv", "urdf"): uuv_urdf,
    ("uuv", "controller"): uuv_controller,
    ("mjcf", "joint"): mjcf,
    ("mss", "python"): mss,
    ("mss", "matlab"): mss,
}


def moved(slope: Slope, moment: float, rate0: float, seconds: float) -> tuple[Floats, Floats]:
    """Times and yaw rates under a constant moment, by scipy's solver."""
    time = np.arange(0.0, seconds, 0.02)
    return time, solve_ivp(lambda _, r: [slope(r[0], moment)], (0, seconds), [rate0], t_eval=time, rtol=1e-8).y[0]


def rise_time(time: Floats, rate: Floats) -> float:
    """When the rate has come 1 - 1/e of its way to the end, between samples."""
    share = (rate - rate[0]) / (rate[-1] - rate[0])
    return float(np.interp(1.0 - np.exp(-1.0), share, time))


def fall_time(time: Floats, rate: Floats) -> float:
    """When the rate has fallen to 1/e of its start, between samples."""
    return float(np.interp(-np.exp(-1.0), -rate / rate[0], time))


# Vehicles: text and velocities (6,) -> accelerations (6,) without commands, upright; zero where nothing is identified

LETTERS = "uvwpqr"


def accelerations(inertia: Floats, force: Floats, nu: Floats, coupled: bool = True) -> Floats:
    """Of M nu' + C(nu) nu = force, of the motions that have an inertia."""
    p, places = inertia @ nu, np.flatnonzero(inertia.diagonal())
    c_nu = np.append(np.cross(nu[3:], p[:3]), np.cross(nu[3:], p[3:]) + np.cross(nu[:3], p[:3]))
    result = np.zeros(6)
    part = inertia[np.ix_(places, places)]
    result[places] = np.linalg.solve(part, (force - coupled * c_nu)[places])
    return result


def own_and_added(added: Floats, mass: float, moments: list[float], linear: Floats, quadratic: Floats) -> Floats:
    """M, where a motion without any entry of the fluid's is a placeholder."""
    there = (np.abs(added).sum(axis=0) + np.abs(linear) + np.abs(quadratic)) > 0
    return added + np.diag(np.array([mass] * 3 + moments) * there)


def gz_vehicle(text: str, nu: Floats) -> Floats:
    root, linear, quadratic, force = ET.fromstring(text), np.zeros(6), np.zeros(6), np.zeros(6)
    plugin, link = root.find(".//plugin"), root.find(".//inertial")
    assert plugin is not None and link is not None and plugin.findtext("disable_added_mass") == "true"
    added = np.zeros((6, 6))
    for entry in link.find("fluid_added_mass") or ():
        i, j = ("xyzpqr".index(letter) for letter in entry.tag)
        added[i, j] = added[j, i] = float(str(entry.text))
    for entry in plugin:
        if match := re.fullmatch(r"([xyzkmn])([UVWPQR])(abs)?([UVWPQR])?", entry.tag):
            value, place, along = float(str(entry.text)), "xyzkmn".index(match[1]), "UVWPQR".index(match[2])
            size = 1.0 if match[4] is None else nu["UVWPQR".index(match[4])]
            force[place] += value * (abs(size) if match[3] else size) * nu[along]
            (quadratic if match[3] else linear)[place] = value
    moments = [number_in(link, f"inertia/i{i}{i}") for i in "xyz"]
    return accelerations(own_and_added(added, number_in(link, "mass"), moments, linear, quadratic), force, nu)


def mss_vehicle(text: str, nu: Floats) -> Floats:
    (rows,) = re.findall(r"^M = \[(.*)\];$", text, re.MULTILINE)
    inertia, force = np.array([[float(x) for x in line.split()] for line in rows.split(";")]), np.zeros(6)
    entries = re.findall(r"^D\((\d),(\d)\) = D\(\1,\2\) \+ (\S+?)(?: \* (abs\()?(\w)\)?)?;", text, re.MULTILINE)
    assert entries and text.startswith("function [nu_dot, M, C, D, g] = vehicle6(nu, tau, eta, nu_c)")
    assert "C = [zeros(3) -S(b(1:3)); -S(b(1:3)) -S(b(4:6))];" in text and "b = M * nu_r;" in text
    assert "S = @(a) [0 -a(3) a(2); a(3) 0 -a(1); -a(2) a(1) 0];" in text  # S(a) b is the cross product of a and b
    for i, j, value, absolute, along in entries:
        size = nu[LETTERS.index(along)] if along else 1.0
        force[int(i) - 1] -= float(value) * (abs(size) if absolute else size) * nu[int(j) - 1]
    return accelerations(inertia, force, nu)


def damped(inertia: Floats, linear: Floats, quadratic: Floats, nu: Floats, coupled: bool) -> Floats:
    return accelerations(inertia, -(linear + quadratic * np.abs(nu)) * nu, nu, coupled)


def uuv_vehicle(text: str, nu: Floats) -> Floats:
    root = ET.fromstring(text)
    model, own, mass = root.find(".//hydrodynamic_model"), root.find("link/inertial/inertia"), root.find(".//mass")
    assert model is not None and own is not None and mass is not None
    added, linear, quadratic = (
        np.array(str(model.findtext(tag)).split(), float)
        for tag in ("added_mass", "linear_damping", "quadratic_damping")
    )
    moments = [float(own.attrib[f"i{i}{i}"]) for i in "xyz"]
    inertia = own_and_added(added.reshape(6, 6), float(mass.attrib["value"]), moments, linear, quadratic)
    return damped(inertia, -linear, -quadratic, nu, True)


def controller_vehicle(text: str, nu: Floats) -> Floats:
    data = yaml.safe_load(text)
    linear, quadratic = np.array(data["linear_damping"], float), np.array(data["quad_damping"], float)
    moments = [data["inertial"][f"i{i}{i}"] for i in "xyz"]
    inertia = own_and_added(np.array(data["Ma"], float), data["mass"], moments, linear, quadratic)
    return damped(inertia, -linear, -quadratic, nu, True)


def mjcf_vehicle(text: str, nu: Floats) -> Floats:
    root, linear, quadratic, inertia = ET.fromstring(text), np.zeros(6), np.zeros(6), np.zeros((6, 6))
    own = root.find("worldbody/body/inertial")
    assert own is not None
    moments = [float(x) for x in own.attrib["diaginertia"].split()]
    for joint in root.findall("worldbody/body/joint"):
        axis = np.abs([float(x) for x in joint.attrib["axis"].split()]).argmax()
        place = int(axis) + 3 * (joint.attrib["type"] == "hinge")
        linear[place], quadratic[place], _ = (float(x) for x in joint.attrib["damping"].split())
        inertia[place, place] = [*[float(own.attrib["mass"])] * 3, *moments][place] + float(joint.get("armature", "0"))
    return damped(inertia, linear, quadratic, nu, False)


def python_vehicle(text: str, nu: Floats) -> Floats:
    space: dict[str, Callable[..., Floats]] = {}
    exec(text.replace("Z_0 =", "Z_0 = 0 *").replace("K_0 =", "K_0 = 0 *"), space)
    return space["derivatives"](np.append(np.zeros(6), nu), np.zeros(6))[6:]


VEHICLES: dict[tuple[str, str], Callable[[str, Floats], Floats]] = {
    ("gz-sim", "fluid-added-mass"): gz_vehicle,
    ("mss", "matlab"): mss_vehicle,
    ("uuv", "urdf"): uuv_vehicle,
    ("uuv", "controller"): controller_vehicle,
    ("mjcf", "joint"): mjcf_vehicle,
    ("python", "simulate"): python_vehicle,
}


# Thrusters: control signal -> thrust, from each file


def constants_law(text: str) -> Callable[[Floats], Floats]:
    """Otter: k_pos n |n| ahead, k_neg n |n| astern, n within its limits."""
    c = constants_of(text)
    assert c["n_min"] < 0 < c["n_max"]

    def law(n: Floats) -> Floats:
        n = np.clip(n, c["n_min"], c["n_max"])
        return np.where(n > 0, c["k_pos"], c["k_neg"]) * n * np.abs(n)

    return law


def table_law(n: Floats, force: Floats) -> Callable[[Floats], Floats]:
    """Straight lines between points in order, the last value beyond them."""
    assert len(n) == len(force) and np.all(np.diff(n) > 0)
    return lambda x: np.interp(x, n, force)


def uuv_law(text: str) -> Callable[[Floats], Floats]:
    plugin = ET.fromstring(text).find(".//plugin")
    assert plugin is not None and plugin.findtext("dynamics/type") in ("ZeroOrder", "FirstOrder")
    low, high = number_in(plugin, "clampMin"), number_in(plugin, "clampMax")
    assert plugin.findtext("conversion/type") == "LinearInterp"
    tags = ("inputValues", "outputValues")
    inner = table_law(*(np.array(str(plugin.findtext(f"conversion/{t}")).split(), float) for t in tags))
    return lambda n: inner(np.clip(n, low, high))


def gz_law(text: str) -> Callable[[Floats], Floats]:
    """Thruster system with use_angvel_cmd: thrust = coefficient density diameter^4 |w| w."""
    plugin = ET.fromstring(text).find(".//plugin[@name='gz::sim::systems::Thruster']")
    assert plugin is not None and plugin.findtext("use_angvel_cmd") == "true" and plugin.findtext("joint_name")
    c, rho, d, low, high = (
        number_in(plugin, tag)
        for tag in ("thrust_coefficient", "fluid_density", "propeller_diameter", "min_thrust_cmd", "max_thrust_cmd")
    )

    def law(n: Floats) -> Floats:
        w = np.clip(n, low, high)
        return c * d**4 * np.abs(w) * w * rho

    return law


LAWS: dict[str, Callable[[str], Callable[[Floats], Floats]]] = {
    "constants": constants_law,
    "uuv-table": uuv_law,
    "gz-thruster": gz_law,
}
