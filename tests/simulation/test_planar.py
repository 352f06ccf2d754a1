"""Surge, sway and yaw together: what is kept, independent solutions, a published craft, and yaw alone as the limit."""

from dataclasses import replace

import numpy as np
import pytest
from made_planar import Craft, Otter, driven, integrated, planar_run, solved
from made_runs import INERTIA, K_RR, mirrored, step_run
from made_sequences import sequence_run
from numpy.typing import NDArray
from tolerances import assert_close

from automarine_cli.dofs import YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import ModelError, RunError
from automarine_cli.models.allocation import twin_forces
from automarine_cli.models.planar import PLACES, CrossDrag, Inertia, PlanarModel
from automarine_cli.models.yaw_model import Term, YawModel
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, Trajectory, product_with, simulate, turning_of

Floats = NDArray[np.float64]
BODY = Inertia(20.0, 32.0, 2.6, m_vr=1.5, m_ur=-0.7, m_uv=0.9)
POSITION, VELOCITY = (2.0, -1.0, 0.7), (0.4, -0.3, 0.5)


def column(values: object) -> Floats:
    """Three values, one a degree of freedom, for all sets and runs."""
    return np.asarray(values, dtype=float).reshape(3, 1, 1)


START = Start(column(POSITION), column(VELOCITY))


def resisted(water: tuple[float, float] | None = (0.25, -0.15)) -> PlanarModel:
    """A vehicle with every kind of drag, alike on no side."""
    return PlanarModel(
        BODY,
        surge=(Term("linear-drag", (3.0,)), Term("quadratic-drag", (18.0,))),
        sway=(Term("quadratic-drag", (40.0,)), Term("linear-drag", (5.0,))),
        yaw=(Term("linear-drag", (0.6,)), Term("quadratic-drag", (2.5,))),
        cross=(
            Term("Y_r", (1.2,)), Term("N_v", (0.8,)), Term("N_vv", (1.7,)), Term("Y_rr", (0.9,)),
            Term("N_vr", (2.2,)), Term("Y_rv", (1.1,)), Term("X_v", (0.4,)),
        ),
        water=water,
    )  # fmt: skip


def smooth(water: tuple[float, float] | None = None) -> PlanarModel:
    """The same body with linear drag alone."""
    own = ((Term("linear-drag", (size,)),) for size in (8.0, 15.0, 2.0))
    return PlanarModel(BODY, *own, cross=(Term("Y_r", (1.2,)), Term("N_v", (0.8,))), water=water)


RESISTED = Craft(
    np.array([[20.0, 0.9, -0.7], [0.9, 32.0, 1.5], [-0.7, 1.5, 2.6]]),
    linear=np.array([[3.0, 0.4, 0.0], [0.0, 5.0, 1.2], [0.0, 0.8, 0.6]]),
    by_own=np.diag([18.0, 40.0, 2.5]),
    by_sway=np.array([[0, 0, 0], [0, 0, 0], [0, 1.7, 2.2]]),
    by_rate=np.array([[0, 0, 0], [0, 1.1, 0.9], [0, 0, 0]]),
)
SMOOTH = Craft(RESISTED.inertia, linear=np.array([[8.0, 0.0, 0.0], [0.0, 15.0, 1.2], [0.0, 0.8, 2.0]]))
"""The two as matrices, for `solved`."""


def free(inertia: Inertia = BODY, length: float = 6.0, step: float = 0.05) -> Trajectory:
    """Six seconds without force or drag."""
    time = np.arange(0, length + 0.1, 0.8)
    none = np.zeros(len(time))
    batch = make_batch([planar_run(time, none, none, none)], step, motion=PLANAR)
    return simulate(PlanarModel(inertia), batch, start=Start(column(POSITION), column((0.8, -0.5, 0.9))))


def kept(found: Trajectory, inertia: Inertia = BODY) -> Floats:
    """Kinetic energy, momentum north and east, angular momentum about the earth's origin, (4, N)."""
    nu, (north, east, psi) = found.velocities[0, 0], found.positions[0, 0].T
    along, abeam, turning = (nu @ inertia.matrix).T
    p_north, p_east = np.cos(psi) * along - np.sin(psi) * abeam, np.sin(psi) * along + np.cos(psi) * abeam
    energy = 0.5 * np.einsum("ni,ij,nj->n", nu, inertia.matrix, nu)
    return np.stack([energy, p_north, p_east, turning + north * p_east - east * p_north])


def test_energy_and_momentum_are_kept_without_drag_and_force() -> None:
    amounts = kept(free(step=0.01))
    np.testing.assert_allclose(amounts, np.broadcast_to(amounts[:, :1], amounts.shape), rtol=1e-8, atol=1e-8)
    assert np.ptp(free().velocities[0, 0], axis=0).min() > 0.1  # the velocities themselves are not


def test_what_is_kept_converges_with_the_fourth_order() -> None:
    errors = []
    for step in (0.2, 0.1, 0.05, 0.025):
        amounts = kept(free(step=step))
        errors.append(np.abs(amounts - amounts[:, :1]).max(axis=1))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.6), orders  # energy does better: a method of fourth order keeps it to the fifth


@pytest.mark.parametrize("water", [None, (0.25, -0.15)])
def test_order_of_convergence_is_four(water: tuple[float, float] | None) -> None:
    """Ahead, to port and clockwise through the water all the time: no drag comes by its corner."""
    model, time = resisted(water), np.arange(0, 6.5, 0.8)
    run = planar_run(time, *(np.full(len(time), one) for one in (15.0, -6.0, 3.0)))
    velocity = (0.4, -0.5, 0.4)
    exact = np.concatenate(solved(RESISTED.in_current(water), run, (0, 0, 0.3), velocity), axis=1)
    start, errors = Start(column((0, 0, 0.3)), column(velocity)), []
    for step in (0.2, 0.1, 0.05, 0.025):
        found = simulate(model, make_batch([run], step, motion=PLANAR), start=start)
        states = np.concatenate([found.positions[0, 0], found.velocities[0, 0]], axis=1)
        errors.append(np.abs(states - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 3.6) & (orders < 4.6)), orders


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("water", [None, (0.25, -0.15), (-0.4, 0.3)])
def test_against_an_independent_solution(seed: int, water: tuple[float, float] | None) -> None:
    run = driven(seed, 7.0)
    for model, own, keyword in ((smooth(water), SMOOTH, "fine rollout"), (resisted(water), RESISTED, "corners")):
        found = simulate(model, make_batch([run], 0.01, motion=PLANAR), start=START)
        positions, velocities = solved(own.in_current(water), run, POSITION, VELOCITY)
        assert_close(found.positions[0, 0], positions, keyword)
        assert_close(found.velocities[0, 0], velocities, keyword)


def test_port_and_starboard_are_alike() -> None:
    """East, heading, v, r, Y, N and what couples them with surge change sign; nothing else does."""
    model, run, sides = resisted(), driven(5), np.array([1.0, -1.0, -1.0])
    other = replace(
        model,
        inertia=replace(BODY, m_ur=-BODY.m_ur, m_uv=-BODY.m_uv),
        cross=tuple(replace(t, values=(-t.values[0],)) if t.name == "X_v" else t for t in model.cross),
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


def test_a_published_craft_with_two_thrusters() -> None:
    """The Otter's own equations, in matrices of Coriolis and over ground, beside ours: ahead, two turns, a stop."""
    time, current = np.arange(0, 40.05, 0.1), np.array([0.3, -0.2])
    left, right = np.array([[100, 80, 60, -40, 0], [80, 100, 60, 50, 0]])[:, np.minimum(time // 8, 4).astype(int)]
    thrust = np.stack([Otter.thrust(left), Otter.thrust(right)])
    run = planar_run(time, *twin_forces(thrust, Otter.arm))
    k_r = -Otter.N_r
    model = PlanarModel(
        Inertia.rigid(Otter.mass, Otter.inertia_z, Otter.x_g) + Inertia(*Otter.added),
        surge=(Term("linear-drag", (-Otter.X_u,)),), sway=(Term("linear-drag", (-Otter.Y_v,)),),
        yaw=(Term("linear-drag", (k_r,)), Term("quadratic-drag", (10 * k_r,))), water=(0.3, -0.2),
    )  # fmt: skip
    found = simulate(model, make_batch([run], 0.01, motion=PLANAR), start=Start(column((0, 0, 0.4))))
    states = integrated(Otter.rates(current), run, (0, 0, 0.4, 0, 0, 0))
    assert_close(found.positions[0, 0], states[:, :3], "corners")
    assert_close(found.velocities[0, 0], states[:, 3:], "corners")
    psi, ahead = states[:, 2], states[:, 3]
    assert ahead.max() > 1.0 and psi.max() > psi[0] + 0.5 and psi.min() < psi.max() - 0.5
    np.testing.assert_allclose(run.command, 0.395 * (thrust[0] - thrust[1]), atol=1e-12)  # more to port turns clockwise


@pytest.mark.parametrize("number", ["1", "2", "3"])
def test_yaw_alone_is_the_limit(number: str) -> None:
    drags = {"1": (0.9,), "2": (0.8, 0.3), "3": (K_RR,)}[number]
    alone = YawModel.base(number, INERTIA, drags, "nu", YAW).with_effect("thruster-lag", (0.3,))
    alone = alone.with_effect("heading-moment", (0.05, -0.03)).with_effect("water-swirl", (0.2, 8.0))
    alone = alone.with_effect("compass-deviation", (0.06, -0.04, 0.03, 0.02))
    together = PlanarModel(Inertia(20.0, 30.0, INERTIA), surge=(Term("quadratic-drag", (9.0,)),), yaw=alone.terms)
    runs = [step_run(0.5), mirrored(step_run(0.9)), sequence_run()]
    planar = [replace(run, extras=dict.fromkeys(("force_X", "force_Y"), 0.0 * run.time)) for run in runs]
    gain = np.array([[0.1, -0.05, 0.0]])
    pushed = np.random.default_rng(0).normal(0, 0.05, (1, 3, make_batch(runs, 0.05).windows))
    still = np.stack([0 * pushed, 0 * pushed, pushed])
    own = simulate(alone, make_batch(runs, 0.05), start=Start(0.4, -0.2, gain, disturbance=pushed))
    start = Start(column((0, 0, 0.4)), column((0, 0, -0.2)), gain, disturbance=still)
    found = simulate(together, make_batch(planar, 0.05, motion=PLANAR), start=start)
    np.testing.assert_allclose(found.positions[..., 2], own.positions[..., 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.velocities[..., 2], own.velocity, rtol=0, atol=1e-12)
    assert not found.positions[..., :2].any() and not found.velocities[..., :2].any()
    read = found.reading(make_batch(planar, 0.05, motion=PLANAR).channels[-1])
    np.testing.assert_allclose(read, own.position, rtol=0, atol=1e-12)


def test_coriolis_does_no_work() -> None:
    rng = np.random.default_rng(2)
    half = rng.normal(size=(7, 3, 3))
    inertia, nu = half @ half.transpose(0, 2, 1), rng.normal(size=(3, 7, 5))
    force = np.stack(turning_of(product_with(inertia)(nu), nu))
    np.testing.assert_allclose((force * nu).sum(axis=0), 0.0, atol=1e-12)
    m, x_g, (u, v, r) = 3.0, 0.4, nu[:, :1]  # Fossen's own matrix of a rigid body
    rigid = Inertia.rigid(m, 0.7, x_g).matrix[None]
    c_13, c_23 = -m * (x_g * r + v), m * u
    expected = np.stack([c_13 * r, c_23 * r, -c_13 * u - c_23 * v])
    np.testing.assert_allclose(turning_of(product_with(rigid)(nu[:, :1]), nu[:, :1]), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("u", "v"), [(0.8, 0.3), (0.8, -0.3), (-0.5, 0.2)])
def test_munk_moment(u: float, v: float) -> None:
    """Held on a steady oblique course the water turns the vehicle broadside; (m_v - m_u) u v holds it."""
    body = Inertia(20.0, 32.0, 2.6)
    held = (body.m_v - body.m_u) * u * v
    time = np.arange(0, 5, 0.1)
    none = np.zeros(len(time))
    start = Start(velocity=column((u, v, 0)))
    for moment in (held, 0.0):
        batch = make_batch([planar_run(time, none, none, none + moment)], 0.05, motion=PLANAR)
        found = simulate(PlanarModel(body), batch, start=start).velocities[0, 0]
        if moment:
            np.testing.assert_allclose(found, np.broadcast_to((u, v, 0), found.shape), rtol=0, atol=1e-13)
        else:
            assert found[1, 2] * held < 0  # to port with way on and drift to starboard
            assert found[1, 2] == pytest.approx(-held / body.I_r * 0.1, rel=0.02)


def test_a_drifting_vehicle_goes_with_the_current() -> None:
    """Without force it ends up at rest in the water, and a sensor over ground shows the current in its own axes."""
    model, time = resisted((0.3, 0.4)), np.arange(0, 120, 0.5)
    run = planar_run(time, *np.zeros((3, len(time))))
    found = simulate(model, make_batch([run], 0.1, motion=PLANAR), start=Start(column((0, 0, 0.9))))
    psi, (u, v, r) = found.positions[0, 0, -1, 2], found.velocities[0, 0, -1]
    drift = np.array([u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi), r])
    np.testing.assert_allclose(drift, (0.3, 0.4, 0.0), atol=2e-3)
    np.testing.assert_allclose(found.velocities[0, 0, 0], 0.0, atol=1e-15)  # it began at rest over ground


def test_effects_see_the_ground_and_the_water() -> None:
    """A brake against the ground holds where drag lets go: Coulomb friction is on the velocity over ground."""
    time, zero = np.arange(0, 60, 0.5), np.zeros(120)
    model = PlanarModel(
        BODY, surge=(Term("linear-drag", (3.0,)), Term("coulomb-drag", (5.0, 0.0, 0.0, 0.1))), water=(0.3, 0.0)
    )
    batch = make_batch([planar_run(time, zero, zero, zero)], 0.05, motion=PLANAR)
    assert abs(simulate(model, batch).velocities[0, 0, -1, 0]) < 0.02  # 3 N s/m at 0.3 m/s are less than 5 N


def test_sets_and_runs_together_are_each_as_if_alone() -> None:
    model, runs = resisted(), [driven(1), driven(2, 7.0), driven(3, 9.0, 0.2)]
    rng = np.random.default_rng(4)
    theta = model.theta * (1 + 0.1 * rng.standard_normal((4, len(model.theta))))
    position, velocity = rng.normal(size=(3, 4, 3)), 0.3 * rng.normal(size=(3, 4, 3))
    gain = 0.1 * rng.normal(size=(4, 3))
    batch = make_batch(runs, 0.05, motion=PLANAR)
    found = simulate(model, batch, theta, Start(position, velocity, gain))
    assert found.positions.shape == found.velocities.shape == (4, 3, max(map(len, runs)), 3)
    for p, values in enumerate(theta):
        for r, run in enumerate(runs):
            start = Start(column(position[:, p, r]), column(velocity[:, p, r]), gain[p, r])
            one = make_batch([run], 0.05, motion=PLANAR)
            alone = simulate(model.with_theta(values), one, start=start)
            for both, own in ((found.positions, alone.positions), (found.velocities, alone.velocities)):
                np.testing.assert_allclose(both[p, r, : len(run)], own[0, 0], rtol=0, atol=1e-13)
    spread = simulate(model, batch, start=Start(velocity=velocity))  # sets of starts of one set of parameters
    assert spread.positions.shape[:2] == (4, 3)


def test_late_switches_move_all_commands() -> None:
    """A change of any command is a switch of its own; those of one interval are one."""
    time = 0.4 * np.arange(25)
    run = planar_run(time, 9.0 * (time > 2), -4.0 * (time > 5), 2.0 * ((time > 2) & (time < 7)))
    batch = make_batch([run], 0.02, motion=PLANAR)
    assert batch.interval.shape == (1, 3) and batch.force.shape[0] == 3
    late = np.array([0.15, -0.1, 0.05])
    moved = simulate(resisted(), batch, start=Start(switch_delay=late[None, None]))
    changes = 1 + np.flatnonzero(np.any(np.diff([run.extras["force_X"], run.extras["force_Y"], run.command]), axis=0))
    instants = (time[changes - 1] + time[changes]) / 2 + late
    dense = np.sort(np.concatenate([time, instants - 1e-9, instants + 1e-9]))  # samples that show each change at once
    held = np.searchsorted(instants, dense)
    levels = np.array([[0, 9, 9, 9], [0, 0, -4, -4], [0, 2, 2, 0]], dtype=float)
    exact = solved(RESISTED.in_current(resisted().water), planar_run(dense, *levels[:, held]), (0, 0, 0), (0, 0, 0))[0]
    assert_close(moved.positions[0, 0], exact[np.isin(dense, time)], "rollout")


def test_channels_of_all_three() -> None:
    run = driven(0)
    logged = {"north": run.time - 50, "east": np.full(len(run), np.nan), "surge": 0.1 * run.time}
    run = replace(run, extras={**run.extras, **logged})
    batch = make_batch([run, driven(1)], 0.1, motion=PLANAR)
    assert [(one.quantity, one.dof, one.velocity) for one in batch.channels] == [
        ("north", 0, False), ("east", 1, False), ("heading", 2, False),
    ]  # fmt: skip
    north, east, heading = batch.channels
    assert north.seen[0].all() and not north.seen[1].any() and not east.seen.any() and heading.seen.all()
    asked = make_batch([run], 0.1, motion=PLANAR, channels=("surge", "yaw_rate", "heading"))
    assert [(one.quantity, one.dof, one.counts) for one in asked.channels] == [
        ("north", 0, False), ("surge", 0, True), ("heading", 2, True), ("yaw_rate", 2, True),
    ]  # fmt: skip
    assert not asked.channels[3].seen.any()  # asked for, but in no log
    found = simulate(resisted(), asked, start=START)
    np.testing.assert_array_equal(found.reading(asked.channels[1]), found.velocities[..., 0])
    np.testing.assert_array_equal(found.reading(asked.channels[2]), found.positions[..., 2])


def test_a_log_without_a_force_is_refused() -> None:
    run = driven(0)
    lacking = replace(run, extras={"force_X": run.extras["force_X"]})
    with pytest.raises(RunError, match="no sway force"):
        make_batch([lacking], 0.1, motion=PLANAR)


def test_parameters_have_qualified_names() -> None:
    model = replace(
        resisted(), yaw=(*resisted().yaw, Term("input-delay", (0.2, 0.0, 0.1)), Term("bias-moment", (0.1,)))
    )
    assert model.parameter_names == (
        "surge.m_u", "sway.m_v", "yaw.I_r", "planar.m_vr", "planar.m_ur", "planar.m_uv",
        "surge.X_u", "surge.X_uu", "sway.Y_vv", "sway.Y_v", "yaw.k_r", "yaw.k_rr", "yaw.input-delay.t_d",
        "yaw.input-delay.law", "yaw.input-delay.t_off",
        "yaw.constant_force", "sway.Y_r", "yaw.N_v", "yaw.N_vv", "sway.Y_rr", "yaw.N_vr", "sway.Y_rv", "surge.X_v",
        "current.north", "current.east",
    )  # fmt: skip
    assert len(set(model.parameter_names)) == len(model.theta)
    assert model.with_theta(model.theta) == model
    values = np.arange(1.0, 1 + len(model.theta))
    changed = model.with_theta(values)
    np.testing.assert_array_equal(changed.theta, values)
    assert changed.inertia.m_vr == 4.0 and changed.surge[1].values == (8.0,) and changed.water == (24.0, 25.0)
    assert "current.north" not in replace(model, water=None).parameter_names
    with pytest.raises(ModelError, match="2 values given for the 25 parameters"):
        model.with_theta([1.0, 2.0])


def test_rigid_body_and_added_mass() -> None:
    body = Inertia.rigid(10.0, 0.5, x_g=0.2, y_g=-0.1)
    lever = np.array([[1, 0, 0.1], [0, 1, 0.2]])  # velocity of the centre of gravity by (u, v, r)
    turning = np.diag([0.0, 0.0, 0.5])
    np.testing.assert_allclose(body.matrix, 10.0 * lever.T @ lever + turning, atol=1e-15)
    model = PlanarModel(Inertia.rigid(10.0, 0.5, 0.2) + Inertia(1.0, 6.0, 0.3, m_vr=0.4))
    np.testing.assert_allclose(model.inertia.matrix, [[11, 0, 0], [0, 16, 2.4], [0, 2.4, 0.5 + 0.4 + 0.3]], atol=1e-15)
    for i, j in PLACES:
        assert model.inertia_matrix(model.theta[None])[0, i, j] == model.inertia.matrix[j, i]
    with pytest.raises(ModelError, match=r"m_v = -2.*positive definite"):
        (Inertia.rigid(10.0, 0.5) + Inertia(1.0, -12.0, 0.3)).refuse_unless_positive("model")


@pytest.mark.parametrize("name", ["Y_v", "N_rr", "Z_r", "Y_rrr", "yaw", "Y_p", "m_vr"])
def test_a_derivative_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ModelError, match=f"cross drag '{name}': expected X, Y or N"):
        PlanarModel(BODY, cross=(Term(name, (1.0,)),))


def test_a_derivative_is_what_its_letters_say() -> None:
    zero = np.zeros((1, 1))
    bounds = PlanarModel(BODY, cross=(Term("N_vr", (2.0,)), Term("Y_r", (3.0,)))).forces(np.ones((1, 8)))
    assert [(one.dof, one.effect) for one in bounds] == [(2, CrossDrag(2, 1)), (1, CrossDrag(2))]
    assert [one.values[0].shape for one in bounds] == [zero.shape] * 2


def test_two_thrusters_push_ahead_and_turn() -> None:
    x, y, n = twin_forces([[5.0, 2.0], [3.0, 2.0]], 0.3)
    np.testing.assert_allclose([x, y, n], [[8, 4], [0, 0], [0.6, 0]], atol=1e-15)
