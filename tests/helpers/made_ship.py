"""A model tanker of seven metres, KVLCC2, by the MMG standard equations and an integrator of its own.

Equations, derivatives and coefficients: Yasukawa and Yoshimura (2015), Journal of Marine Science and Technology 20:37.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd

from automarine_cli.quantities import Floats

DENSITY, LENGTH, DRAUGHT, DISPLACED, AHEAD_OF_MIDSHIPS = 1000.0, 7.0, 0.46, 3.27, 0.25  # kg/m³, m, m, m³, m
DIAMETER, RUDDER_SPAN, RUDDER_AREA, RUDDER_RATE = 0.216, 0.345, 0.0539, np.deg2rad(15.8)  # m, m, m², per s
REVOLUTIONS, SPEED, STEP = 10.4, 1.18, 0.05  # per s, m/s, s
LATERAL = 0.5 * DENSITY * LENGTH * DRAUGHT  # kg/m
MASS = DENSITY * DISPLACED
MASS_AHEAD, MASS_ABEAM = (MASS + share * LATERAL * LENGTH for share in (0.022, 0.223))
INERTIA = MASS * ((0.25 * LENGTH) ** 2 + AHEAD_OF_MIDSHIPS**2) + 0.011 * LATERAL * LENGTH**3
"""About midships, with added inertia: kg, kg and kg m²."""
Order = Callable[[float, float], float]
"""The rudder that is ordered [rad], by the time [s] and the turn from the first course [rad]."""


def zigzag(rudder_deg: float, heading_deg: float) -> Order:
    """Order the rudder over each time the vehicle has turned so far from its course to the side it turns to."""
    size, side = np.deg2rad(abs(rudder_deg)), [np.sign(rudder_deg)]

    def order(time: float, turn: float) -> float:
        if side[0] * turn >= np.deg2rad(heading_deg):
            side[0] = -side[0]
        return float(side[0] * size) if time > 3.0 else 0.0

    return order


def thrust(u: float, angle: float, turning: float) -> tuple[float, float, float]:
    """Force ahead [N], advance ratio and thrust coefficient of the propeller in the hull's wake."""
    wake = 0.4 * np.exp(-4.0 * (angle + 0.48 * turning) ** 2)
    advance = (1.0 - wake) * u / (REVOLUTIONS * DIAMETER)
    coefficient = 0.2931 - 0.2753 * advance - 0.1385 * advance**2
    return 0.78 * DENSITY * coefficient * REVOLUTIONS**2 * DIAMETER**4, advance, coefficient


def slope(state: Floats, rudder: float) -> Floats:
    """Derivatives by time of surge, sway and yaw rate about midships, north, east and heading."""
    u, v, r, _, _, heading = state
    speed = np.hypot(u, v)
    angle, across, turning = np.arctan2(-v, u), v / speed, r * LENGTH / speed
    ahead, advance, coefficient = thrust(u, angle, turning)
    drifting = angle + 0.71 * turning
    race = np.sqrt(1.0 + 8.0 * coefficient / (np.pi * advance**2)) - 1.0
    share = DIAMETER / RUDDER_SPAN
    passing = advance * REVOLUTIONS * DIAMETER * 1.09 * np.sqrt(share * (1.0 + 0.5 * race) ** 2 + 1.0 - share)
    crossing = speed * (0.395 if drifting < 0 else 0.64) * drifting
    incidence = rudder - np.arctan2(crossing, passing)
    lift = 0.5 * DENSITY * RUDDER_AREA * 2.747 * (passing**2 + crossing**2) * np.sin(incidence)
    powers = np.array([across, turning, across**3, across**2 * turning, across * turning**2, turning**3])
    pressure = LATERAL * speed**2
    drag = -0.022 - 0.04 * across**2 + 0.002 * across * turning + 0.011 * turning**2 + 0.771 * across**4
    x = pressure * drag + ahead - 0.613 * lift * np.sin(rudder)
    y = pressure * powers @ [-0.315, 0.083, -1.607, 0.379, -0.391, 0.008] - 1.312 * lift * np.cos(rudder)
    n = pressure * LENGTH * powers @ [-0.137, -0.049, -0.03, -0.294, 0.055, -0.013]
    n += 0.64477 * LENGTH * lift * np.cos(rudder)
    arm = MASS * AHEAD_OF_MIDSHIPS
    surging = (x + MASS_ABEAM * v * r + arm * r**2) / MASS_AHEAD
    turned = np.linalg.solve([[MASS_ABEAM, arm], [arm, INERTIA]], [y - MASS_AHEAD * u * r, n - arm * u * r])
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.array([surging, *turned, u * cosine - v * sine, u * sine + v * cosine, r])


def log(order: Order, length: float, seed: int, every: float = 0.2) -> pd.DataFrame:
    """Log a test from a straight course of its own, a row `every` so many seconds, with the noise of good sensors."""
    noise, course = np.random.default_rng(seed), np.deg2rad(30.0 * seed)
    state, rudder, rows = np.array([SPEED, 0, 0, 0, 0, course]), 0.0, []
    for k in range(round(length / STEP) + 1):
        if k % round(every / STEP) == 0:
            u, v, r, north, east, heading = state
            sizes = np.array([0.03, 0.03, 0.005, 0.005, 0.02, 0.02])
            shown = np.array([*np.rad2deg([heading, r]), u, v, north, east]) + sizes * noise.standard_normal(6)
            force = thrust(u, np.arctan2(-v, u), r * LENGTH / np.hypot(u, v))[0]
            rows.append((k * STEP, np.rad2deg(rudder), force, shown[0] % 360, *shown[1:]))
        before, asked = rudder, order(k * STEP, state[5] - course)
        rudder += float(np.clip(asked - rudder, -RUDDER_RATE * STEP, RUDDER_RATE * STEP))
        middle = state + 0.5 * STEP * slope(state, before)
        state = state + STEP * slope(middle, 0.5 * (before + rudder))
    columns = "time_s rudder_deg force_X_N heading_deg yaw_rate_deg_s surge_m_s sway_m_s north_m east_m"
    return pd.DataFrame(rows, columns=columns.split()).round(4)
