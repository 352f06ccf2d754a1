"""The ArduSub and Rover stacks once more, scalar and with MuJoCo's vehicle: they agree with ours to half a degree.

Here the controllers are written loop by loop for one vehicle, delays and thrusters are of their own, and the vehicle is
a hinge in MuJoCo's integrator: nothing of `automarine_cli.control` is used for this side.
"""

from collections import deque
from math import copysign, pi, sqrt
from typing import Any

import numpy as np
import pytest
from made_vehicles import gains_of, vehicle

from automarine_cli.control.design import step_and_load
from automarine_cli.control.targets import get

mujoco: Any = pytest.importorskip("mujoco", reason="MuJoCo is in the group simulators")

HULL = """<mujoco><option timestep="0.0025" gravity="0 0 0" integrator="RK4"/><worldbody><body>
<joint name="yaw" type="hinge" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="{i} {i} {i}"/>
</body></worldbody></mujoco>"""
CASES = [
    (0.59, 1.5, 30.0, 0.03, 0.02), (0.59, 1.5, 30.0, 0.10, 0.05), (1.018, 1.257, 1.2, 0.15, 0.30),
    (29.0, 30.0, 40.0, 0.2, 0.5),
]  # fmt: skip


class Sub:
    """ArduSub's yaw, one loop at a time."""

    step = 0.0025

    def __init__(self, p: dict[str, float]) -> None:
        self.p = p
        self.target = self.turn = self.asked = self.demand = self.integral = self.out = 0.0
        self.error = self.slope = self.a = self.b = 0.0

    def loop(self, reference: float, heading: float, rate: float) -> float:
        """Rate controller first, the angle loop for the next."""
        p, dt, w = self.p, self.step, 2 * pi * 20.0
        self.a = (self.a + dt * w * w * (rate - self.b)) / (1 + sqrt(2) * w * dt + (w * dt) ** 2)
        self.b += dt * self.a
        self.demand += (self.asked - self.demand) * dt / (dt + 1 / (2 * pi * p["ATC_RAT_YAW_FLTT"]))
        error = self.demand - self.b
        self.slope += ((error - self.error) / dt - self.slope) * dt / (dt + 1 / (2 * pi * p["ATC_RAT_YAW_FLTD"]))
        self.error = error
        if abs(self.out) < 1.0 or self.integral * error < 0:
            self.integral += p["ATC_RAT_YAW_I"] * dt * error
        imax = p["ATC_RAT_YAW_IMAX"]
        self.integral = min(max(self.integral, -imax), imax)
        self.out = p["ATC_RAT_YAW_P"] * error + self.integral + p["ATC_RAT_YAW_D"] * self.slope
        limit = p["ATC_ACCEL_Y_MAX"] / 100 * pi / 180
        wish = root(reference - self.target, 1 / p["ATC_INPUT_TC"], limit, dt)
        slew = p["ATC_SLEW_YAW"] / 100 * pi / 180
        wish = min(max(wish, -slew), slew)
        self.turn += min(max(wish - self.turn, -limit * dt), limit * dt)
        self.target += self.turn * dt
        pull = min(max(limit / 2, 10 * pi / 180), 120 * pi / 180)
        gain, wanted = p["ATC_ANG_YAW_P"], 1 / p["ATC_RAT_YAW_P"]
        far = wanted / gain if wanted < pull / gain else pull / (2 * gain**2) + wanted**2 / (2 * pull)
        most = min(45 * pi / 180, far)
        left = min(max(self.target - heading, -most), most)
        self.target = heading + left
        self.asked = root(left, gain, pull, dt) + self.turn
        return min(max(self.out, -1.0), 1.0)


class Rover:
    """Rover's steering, one loop at a time."""

    step = 0.02

    def __init__(self, p: dict[str, float]) -> None:
        self.p = p
        self.asked = self.error = self.integral = self.out = self.a = self.b = 0.0

    def loop(self, reference: float, heading: float, rate: float) -> float:
        p, dt, w = self.p, self.step, 2 * pi * 4.0
        self.a = (self.a + dt * w * w * (rate - self.b)) / (1 + sqrt(2) * w * dt + (w * dt) ** 2)
        self.b += dt * self.a
        left, limit = reference - heading, p["ATC_STR_ACC_MAX"] * pi / 180
        wish, most = p["ATC_STR_ANG_P"] * left, sqrt(2 * abs(left) * limit)
        wish = min(max(wish, -most), most)
        self.asked += min(max(wish - self.asked, -limit * dt), limit * dt)
        fastest = p["ATC_STR_RAT_MAX"] * pi / 180
        self.asked = min(max(self.asked, -fastest), fastest)
        error = self.error + (self.asked - self.b - self.error) * dt / (dt + 1 / (2 * pi * p["ATC_STR_RAT_FLTE"]))
        if abs(self.out) < 1.0 or self.integral * error < 0:
            self.integral = min(max(self.integral + p["ATC_STR_RAT_I"] * dt * error, -1.0), 1.0)
        slope = p["ATC_STR_RAT_D"] * (error - self.error) / dt
        self.error = error
        self.out = p["ATC_STR_RAT_FF"] * self.asked + p["ATC_STR_RAT_P"] * error + self.integral + slope
        return min(max(self.out, -1.0), 1.0)


def root(error: float, gain: float, limit: float, dt: float) -> float:
    """Velocity towards a target from which `limit` can stop."""
    near = limit / gain**2
    wish = gain * abs(error) if abs(error) <= near else sqrt(2 * limit * (abs(error) - near / 2))
    return copysign(min(wish, abs(error) / dt), error)


def flown(stack: Any, case: tuple[float, ...], reference: float, load: float, seconds: float) -> list[float]:
    inertia, drag, full, lag, delay = case
    model = mujoco.MjModel.from_xml_string(HULL.format(i=inertia))
    data = mujoco.MjData(model)
    fine = model.opt.timestep
    late = deque([0.0] * round(delay / fine))

    def resist(_: Any, now: Any) -> None:
        now.qfrc_passive[0] -= drag * abs(now.qvel[0]) * now.qvel[0]

    mujoco.set_mjcb_passive(resist)
    thrust, found = 0.0, []
    for k in range(round(seconds / fine)):
        if k % round(stack.step / fine) == 0:
            output = stack.loop(reference, float(data.qpos[0]), float(data.qvel[0]))
        if k % round(0.1 / fine) == 0:
            found.append(float(data.qpos[0]))
        late.append(full * output)
        before, thrust = thrust, thrust + (late.popleft() - thrust) * -np.expm1(-fine / lag)
        data.qfrc_applied[0] = 0.5 * (before + thrust) - load * full
        mujoco.mj_step(model, data)
    mujoco.set_mjcb_passive(None)
    return found


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("name", "twin"), [("ardusub", Sub), ("ardurover", Rover)])
def test_the_stacks_agree_with_a_loop_in_mujoco_to_half_a_degree(name: str, twin: Any, case: tuple[float, ...]) -> None:
    """Defaults and careful gains, a step of 90 degrees and a load, also where the loop swings on and on."""
    target = get(name)
    inertia, drag, full, lag, delay = case
    one = vehicle(inertia, drag, full, lag, delay)
    careful = (
        {
            "ATC_ANG_YAW_P": 0.5,
            "ATC_RAT_YAW_P": 0.1,
            "ATC_RAT_YAW_I": 0.02,
            "ATC_RAT_YAW_D": 0.01,
            "ATC_RAT_YAW_FLTD": 20.0,
        }
        if name == "ardusub"
        else {"ATC_STR_ANG_P": 1.0, "ATC_STR_RAT_P": 0.1, "ATC_STR_RAT_FF": 0.05, "ATC_STR_RAT_D": 0.02}
    )
    for changed in ({}, careful):
        own = gains_of(target, **changed)
        ours = step_and_load(target, own, one, pi / 2, 0.1, 12.0)
        for place, (reference, load) in enumerate(((pi / 2, 0.0), (0.0, 0.1))):
            theirs = np.array(flown(twin({**target.defaults, **changed}), case, reference, load, 12.0))
            gap = np.rad2deg(np.abs(ours.position[0, place] - theirs))
            assert gap.max() < 0.5
