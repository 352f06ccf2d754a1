"""Surge, sway and yaw together: what stays, independent solutions, a published craft, and yaw alone as the limit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_planar import ARM_M, Craft, delivered, driven, of_two_thrusters, planar_model, planar_run, solved
from made_runs import INERTIA, mirrored, step_run
from made_sequences import sequence_run
from numpy.typing import NDArray
from tolerances import assert_close

from automarine_cli.dofs import PLANAR, YAW
from automarine_cli.models.model import Model, Term
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, Trajectory, product_with, simulate

Floats = NDArray[np.float64]
BODY = (20.0, 32.0, 2.6, 1.5, -0.7, 0.9)
POSITION, VELOCITY = (2.0, -1.0, 0.7), (0.4, -0.3, 0.5)


def column(values: object) -> Floats:
    """Three values, one a degree of freedom, for all sets and runs."""
    return np.asarray(values, dtype=float).reshape(3, 1, 1)


START = Start(column(POSITION), column(VELOCITY))


def resisted(water: tuple[float, float] | None = (0.25, -0.15)) -> Model:
    """A vehicle with every kind of drag, alike on no side."""
    return planar_model(
        *BODY,
        surge=(Term("linear-drag", (3.0,)), Term("quadratic-drag", (18.0,))),
        sway=(Term("quadratic-drag", (40.0,)), Term("linear-drag", (5.0,))),
        yaw=(Term("linear-drag", (0.6,)), Term("quadratic-drag", (2.5,))),
        cross=(
            Term("Y_r", (1.2,)), Term("N_v", (0.8,)), Term("N_vv", (1.7,)), Term("Y_rr", (0.9,)),
            Term("N_vr", (2.2,)), Term("Y_rv", (1.1,)), Term("X_v", (0.4,)),
        ),
        water=water,
    )  # fmt: skip


RESISTED = Craft(
    np.array([[20.0, 0.9, -0.7], [0.9, 32.0, 1.5], [-0.7, 1.5, 2.6]]),
    linear=np.array([[3.0, 0.4, 0.0], [0.0, 5.0, 1.2], [0.0, 0.8, 0.6]]),
    by_own=np.diag([18.0, 40.0, 2.5]),
    by_sway=np.array([[0, 0, 0], [0, 0, 0], [0, 1.7, 2.2]]),
    by_rate=np.array([[0, 0, 0], [0, 1.1, 0.9], [0, 0, 0]]),
)
"""The same as matrices, for `solved`."""


def invariants(trajectory: Trajectory) -> Floats:
    """Kinetic energy, momentum north and east, angular momentum about the earth's origin, (4, N)."""
    nu, (north, east, psi) = trajectory.velocities[0, 0], trajectory.positions[0, 0].T
    along, abeam, turning = (nu @ RESISTED.inertia).T
    p_north, p_east = np.cos(psi) * along - np.sin(psi) * abeam, np.sin(psi) * along + np.cos(psi) * abeam
    energy = 0.5 * np.einsum("ni,ij,nj->n", nu, RESISTED.inertia, nu)
    return np.stack([energy, p_north, p_east, turning + north * p_east - east * p_north])


def test_energy_and_momentum_stay_without_drag_and_force() -> None:
    time = np.arange(0, 6.1, 0.8)
    batch = make_batch([planar_run(time, *np.zeros((3, len(time))))], 0.01, motion=PLANAR)
    free = simulate(planar_model(*BODY), batch, start=Start(column(POSITION), column((0.8, -0.5, 0.9))))
    amounts = invariants(free)
    np.testing.assert_allclose(amounts, np.broadcast_to(amounts[:, :1], amounts.shape), rtol=1e-8, atol=1e-8)
    assert np.ptp(free.velocities[0, 0], axis=0).min() > 0.1  # the velocities themselves do not


@pytest.mark.parametrize(("seed", "water"), [(0, None), (1, (0.25, -0.15)), (2, (-0.4, 0.3))])
def test_against_an_independent_solution(seed: int, water: tuple[float, float] | None) -> None:
    run = driven(seed, 7.0)
    trajectory = simulate(resisted(water), make_batch([run], 0.01, motion=PLANAR), start=START)
    positions, velocities = solved(RESISTED.in_current(water), run, POSITION, VELOCITY)
    assert_close(trajectory.positions[0, 0], positions, "corners")
    assert_close(trajectory.velocities[0, 0], velocities, "corners")


@pytest.mark.parametrize(
    ("name", "values", "truth"),
    [
        ("thruster-imbalance", (0.1, -0.05, 0.2), {"gains": (1.2 * 1.1, 0.8 * 0.95, 1.2 * 0.9, 0.8 * 1.05)}),
        ("thruster-dead-band", (ARM_M * 4.0,), {"dead_N": 4.0}),
    ],
)
def test_what_single_thrusters_do_acts_on_the_force_ahead_too(
    name: str, values: tuple[float, ...], truth: dict[str, Any]
) -> None:
    run = driven(3, 7.0)
    model = resisted(None).with_term(Term(name, values, dof=2))
    batch = make_batch([of_two_thrusters(run)], 0.01, model.signals, motion=PLANAR)
    trajectory = simulate(model, batch, start=START)
    positions, velocities = solved(RESISTED.in_current(None), delivered(run, **truth), POSITION, VELOCITY)
    assert_close(trajectory.positions[0, 0], positions, "corners")
    assert_close(trajectory.velocities[0, 0], velocities, "corners")


def test_port_and_starboard_are_alike() -> None:
    """East, heading, v, r, Y, N and what couples them with surge change sign; nothing else does."""
    model, run, sides = resisted(), driven(5), np.array([1.0, -1.0, -1.0])
    other = replace(
        model,
        masses=(*BODY[:4], -BODY[4], -BODY[5]),
        terms=tuple(replace(t, values=(-t.values[0],)) if t.name == "X_v" else t for t in model.terms),
        water=(0.25, 0.15),
    )
    flipped = planar_run(run.time, run.extras["force_X"], -run.extras["force_Y"], -run.command)
    there = simulate(model, make_batch([run], 0.02, motion=PLANAR), start=START)
    start = Start(column(sides * POSITION), column(sides * VELOCITY))
    back = simulate(other, make_batch([flipped], 0.02, motion=PLANAR), start=start)
    np.testing.assert_allclose(back.positions, sides * there.positions, rtol=0, atol=1e-13)
    np.testing.assert_allclose(back.velocities, sides * there.velocities, rtol=0, atol=1e-13)
    exact = solved(RESISTED.in_current(model.water).mirrored(), flipped, sides * POSITION, sides * VELOCITY)[0]
    assert_close(back.positions[0, 0], exact, "rollout")


def test_yaw_alone_is_the_limit() -> None:
    alone = Model.base("2", INERTIA, (0.8, 0.3), "nu", YAW).with_effect("thruster-lag", (0.3,))
    alone = alone.with_effect("heading-moment", (0.05, -0.03)).with_effect("water-swirl", (0.2, 8.0))
    alone = alone.with_effect("compass-deviation", (0.06, -0.04, 0.03, 0.02))
    together = planar_model(20.0, 30.0, INERTIA, surge=(Term("quadratic-drag", (9.0,)),), yaw=alone.terms)
    runs = [step_run(0.5), mirrored(step_run(0.9)), sequence_run()]
    batch = make_batch(runs, 0.05)
    extras = (dict.fromkeys(("force_X", "force_Y"), 0.0 * run.time) for run in runs)
    planar = make_batch([replace(run, extras=x) for run, x in zip(runs, extras)], 0.05, motion=PLANAR)
    gain = np.array([[0.1, -0.05, 0.0]])
    pushed = np.random.default_rng(0).normal(0, 0.05, (1, 3, batch.windows))
    yaw = simulate(alone, batch, start=Start(0.4, -0.2, gain, disturbance=pushed))
    still = np.stack([0 * pushed, 0 * pushed, pushed])
    start = Start(column((0, 0, 0.4)), column((0, 0, -0.2)), gain, disturbance=still)
    plane = simulate(together, planar, start=start)
    np.testing.assert_allclose(plane.positions[..., 2], yaw.positions[..., 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(plane.velocities[..., 2], yaw.velocity, rtol=0, atol=1e-12)
    assert not plane.positions[..., :2].any() and not plane.velocities[..., :2].any()
    np.testing.assert_allclose(plane.reading(planar.channels[-1]), yaw.position, rtol=0, atol=1e-12)


def test_drag_is_against_the_water_and_friction_against_the_ground() -> None:
    """Without force it ends up at rest in the water, and a sensor over ground shows the current in its axes; a Coulomb
    brake against the ground holds where drag lets go."""
    time = np.arange(0, 120, 0.5)
    batch = make_batch([planar_run(time, *np.zeros((3, len(time))))], 0.1, motion=PLANAR)
    drifting = simulate(resisted((0.3, 0.4)), batch, start=Start(column((0, 0, 0.9))))
    psi, (u, v, r) = drifting.positions[0, 0, -1, 2], drifting.velocities[0, 0, -1]
    drift = np.array([u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi), r])
    np.testing.assert_allclose(drift, (0.3, 0.4, 0.0), atol=2e-3)
    np.testing.assert_allclose(drifting.velocities[0, 0, 0], 0.0, atol=1e-15)  # it began at rest over ground
    surge = (Term("linear-drag", (3.0,)), Term("coulomb-drag", (5.0, 0.0, 0.0, 0.1)))
    braked = simulate(planar_model(*BODY, surge=surge, water=(0.3, 0.0)), batch)
    assert abs(braked.velocities[0, 0, -1, 0]) < 0.02  # 3 N s/m at 0.3 m/s are less than 5 N


def test_a_mass_without_limit_does_not_move() -> None:
    """A search may come that far; the inverse of its inertia has nothing in that row."""
    inverse = np.diag([0.0, 1.0, 2.0])[None]
    moved = product_with(inverse)(np.ones((3, 1, 4)))
    np.testing.assert_array_equal(np.stack(moved)[:, 0, 0], [0.0, 1.0, 2.0])
