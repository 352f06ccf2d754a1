"""`mujoco.sysid`: parameters of a MuJoCo model by box-constrained least squares over rollouts."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
from mujoco import sysid
from real_baseline import STEP, Plain, anchors_of

from automarine_cli.runs.run import Run

TITLE, PACKAGE = "mujoco.sysid", "mujoco"
GIVEN = (
    "A hinge with polynomial joint damping (drag exactly quadratic), Runge-Kutta steps of 0.05 s. Whole runs. "
    "Free: inertia, drag, a delay of the sensor, each start heading. Start values 2, 2, 0. Optimizer `mujoco`, "
    "intervals by `calculate_intervals`. Predictions: rollouts of 5 s."
)
VEHICLE = """
<mujoco>
  <option gravity="0 0 0" timestep="0.05" integrator="RK4"/>
  <worldbody>
    <body name="hull">
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint name="yaw" type="hinge" axis="0 0 1" damping="0 1"/>
    </body>
  </worldbody>
  <actuator><motor name="tau" joint="yaw"/></actuator>
  <sensor><jointpos name="heading" joint="yaw"/></sensor>
</mujoco>
"""
PUSHED = VEHICLE.replace("</actuator>", '<motor name="push" joint="yaw" gear="0"/></actuator>').replace("0.05", "0.1")


def fit(folder: Path) -> dict[str, list[float]]:
    """Inertia and drag, each with its 95 % interval."""
    spec = mujoco.MjSpec.from_string(VEHICLE)
    model = spec.compile()
    runs = []
    for path in sorted(folder.glob("*.csv")):
        log = pd.read_csv(path)
        time = (log["time_s"] - log["time_s"][0]).to_numpy()
        heading = np.unwrap(np.radians(log["heading_deg"]))
        heading -= heading[: int(np.argmax(log["tau"] != 0))].mean()
        grid = np.arange(0, time[-1] + 0.6, 0.05)
        held = log["tau"].to_numpy()[np.searchsorted(time, grid + 1e-6) - 1]
        runs.append(sysid.ModelSequences(
            "vehicle", spec, path.stem, sysid.create_initial_state(model, np.zeros(1), np.zeros(1)),
            sysid.TimeSeries.from_control_names(grid, held[:, None], model),
            sysid.TimeSeries.from_names(time, heading[:, None], model, names=["heading"]),
        ))  # fmt: skip
    params = sysid.ParameterDict()
    params.add(sysid.Parameter(
        "I_r", 2.0, 0.01, 100.0, modifier=lambda s, p: setattr(s.body("hull"), "inertia", np.full(3, p.value[0]))
    ))  # fmt: skip
    params.add(sysid.Parameter(
        "k_rr", 2.0, 0.01, 100.0, modifier=lambda s, p: setattr(s.joint("yaw"), "damping", [0, p.value[0], 0])
    ))  # fmt: skip
    params.add(sysid.Parameter("delay", 0.0, -0.5, 0.5))
    read = sysid.SignalTransform()
    read.delay("heading", params["delay"])

    def centred(*args, **more):  # type: ignore[no-untyped-def]
        miss, predicted, measured = read.apply(*args, **more)
        return miss - miss.mean(), predicted, measured

    misses = sysid.build_residual_fn(models_sequences=runs, modify_residual=centred)
    found, best = sysid.optimize(params, misses, optimizer="mujoco", verbose=False)
    _, half = sysid.calculate_intervals(misses(best.x, found)[0], best.jac)
    return {name: [best.x[i], best.x[i] - half[i], best.x[i] + half[i]] for i, name in enumerate(("I_r", "k_rr"))}


def motion(runs: Sequence[Run]) -> Plain:
    """Inertia and drag of driven logs, by rollouts of five seconds from states that the second before shows."""
    anchors, spec = anchors_of(runs), mujoco.MjSpec.from_string(PUSHED)
    model = spec.compile()
    whole = np.flatnonzero(np.isfinite(anchors.reached[:, 1]))[::3]
    grid, force, pace = STEP * np.arange(51), np.nanmax(np.abs(anchors.force)), float(np.std(anchors.rate))
    states, controls, shown = [], [], []
    for a in whole:
        run, first = runs[anchors.run[a]], anchors.sample[a]
        seen = np.interp(run.time[first] + grid, run.time, run.position) - anchors.position[a]
        given = np.append(anchors.force[a, :50], 0.0) / force
        controls.append(sysid.TimeSeries.from_control_names(grid, np.stack([given, np.ones(51)], axis=1), model))
        shown.append(sysid.TimeSeries.from_names(grid, seen[:, None], model, names=["heading"]))
        states.append(sysid.create_initial_state(model, np.zeros(1), anchors.rate[[a]]))
    drives = sysid.ModelSequences("vehicle", spec, [f"{a}" for a in whole], states, controls, shown)
    params = sysid.ParameterDict()
    typical = 1.0 / max(pace, 1e-6)
    heavy, drags = np.log(3 * typical), np.log([typical / 2, typical / 2 / pace])
    # in units of the largest force; logarithms, since sizes are unknown
    params.add(sysid.Parameter("inertia", heavy, heavy - 7, heavy + 7,
        modifier=lambda s, p: setattr(s.body("hull"), "inertia", np.full(3, np.exp(p.value[0])))))  # fmt: skip
    params.add(sysid.Parameter(
        "damping", drags, drags - 7, drags + 7,
        modifier=lambda s, p: setattr(s.joint("yaw"), "damping", [*np.exp(p.value), 0]),
    ))  # fmt: skip
    if runs[0].dof.has_constant:
        params.add(sysid.Parameter("push", 0.0, -1.0, 1.0,
            modifier=lambda s, p: setattr(s.actuator("push"), "gear", [p.value[0], 0, 0, 0, 0, 0])))  # fmt: skip
    found, _ = sysid.optimize(
        params, sysid.build_residual_fn(
            models_sequences=[drives], modify_residual=sysid.SignalTransform(False).apply, n_threads=1
        ),
        optimizer="mujoco", verbose=False, max_iters=8,
    )  # fmt: skip
    inertia, linear, quadratic = force * np.exp(found.as_vector()[:3])
    push = force * found.as_vector()[3] if runs[0].dof.has_constant else 0.0
    return Plain("2", float(inertia), float(linear), float(quadratic), float(push))
