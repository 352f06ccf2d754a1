"""Steps that take several sample intervals where no command has changed for a while."""

from dataclasses import replace

import numpy as np
import pytest
from effect_contract import base_for, law_names, long_plans, of_law, sizes_of, unmeasured

from automarine_cli import effects
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.simulation.batch import SETTLED_S, make_batch
from automarine_cli.simulation.rollout import simulate

RUNS = [unmeasured(plan, i) for i, plan in enumerate(long_plans()[::3])]
LARGEST_DEG = {"coulomb-drag": 0.1, "thruster-lag": 0.06, "rudder": 0.1}
"""Where a run stands still at once, where a thruster is still on its way when the steps grow, and where a speed that
changes all the time is squared; elsewhere 0.02."""


@pytest.mark.parametrize("name", ["", *law_names()])
def test_every_effect_is_simulated_as_with_a_step_for_each_sample(name: str) -> None:
    model = base_for("")
    if name:
        effect, law = of_law(name)
        model = base_for(effect.name).with_effect(effect.name, sizes_of(effect, law))
    short, settled = make_batch(RUNS, 0.1, model.signals), make_batch(RUNS, 0.1, model.signals, settled_step=0.2)
    if set(model.signals) & set(PARTS):  # these thrusters change all the time
        assert settled.length.shape == short.length.shape
    else:
        assert settled.length.shape[1] < 0.75 * short.length.shape[1] and settled.inner.shape[2] == 1
    np.testing.assert_allclose(settled.time, short.time, atol=1e-9)
    expected, got = simulate(model, short), simulate(model, settled)
    for of, unit in (("position", 1.0), ("velocity", 5.0)):
        apart = np.abs(getattr(got, of) - getattr(expected, of))[:, short.seen]
        largest = next((limit for start, limit in LARGEST_DEG.items() if name.startswith(start)), 0.02)
        assert np.degrees(apart.max()) < unit * largest


@pytest.mark.parametrize("name", [name for name in effects.names() if effects.get(name).place is effects.Place.SENSOR])
def test_sensors_read_the_same_where_steps_hold_different_numbers_of_samples(name: str) -> None:
    """Two samples a step soon after a command, four later: no time may pass at nodes without a sample."""
    model = base_for("").with_effect(name, sizes_of(effects.get(name)))
    short = make_batch(RUNS, 0.1, model.signals)
    joined = make_batch(RUNS, 0.2, model.signals, settled_step=0.4)
    assert {*np.round(joined.length[joined.length > 0], 3)} >= {0.2, 0.4} and joined.inner.shape[2] == 3
    apart = (simulate(model, joined).position - simulate(model, short).position)[:, short.seen]
    assert np.degrees(np.abs(apart).max()) < 0.03


def test_steps_grow_only_where_commands_have_settled_and_hold_what_they_may() -> None:
    run = RUNS[0]
    uneven = replace(run, time=run.time + 0.02 * np.sin(5.0 * run.time))
    for log, most in ((run, 0.2), (uneven, 0.35)):
        batch = make_batch([log], 0.1, ["surge"], settled_step=most)
        begins = np.cumsum(batch.length[0]) - batch.length[0]
        changes = (log.time - log.time[0])[1:][np.diff(log.command) != 0]
        since = begins - np.append(-np.inf, changes)[np.searchsorted(changes, begins + 1e-9)]
        long = batch.length[0] > 0.13
        assert long.any() and batch.length.max() <= most + 1e-9 and since[long].min() >= SETTLED_S - 1e-6
        np.testing.assert_allclose(batch.time[0], log.time - log.time[0], atol=1e-9)
        weighed = float(batch.signals["surge"][0] @ batch.length[0]) / float(log.time[-1] - log.time[0])
        held = float(log.extras["surge"][:-1] @ np.diff(log.time)) / float(log.time[-1] - log.time[0])
        assert weighed == pytest.approx(held, rel=2e-3)


@pytest.mark.parametrize("name", ["", "thruster-lag", "input-delay", "rudder-rate", "saturation", "water-swirl"])
def test_commands_that_change_all_the_time_are_averaged_over_steps_of_fast_logs(name: str) -> None:
    """A command that goes over steadily, as a rudder does, and rests."""
    time = np.arange(0.0, 24.0, 0.02)
    command = np.clip(1.5 * np.sin(0.7 * time), -0.8, 0.8)
    extras = {name: np.interp(time, RUNS[0].time, column) for name, column in RUNS[0].extras.items()}
    run = replace(RUNS[0], time=time, position=0.0 * time, moment=command, extras=extras)
    model = base_for("").with_effect(name, sizes_of(effects.get(name))) if name else base_for("")
    short = make_batch([run], 0.02, model.signals)
    joined = make_batch([run], 0.1, model.signals, settled_step=0.2, moving_step=0.05)
    assert 3 * joined.length.shape[1] < short.length.shape[1] < 2 * len(time)
    assert float((joined.force[0] * joined.length).sum()) == pytest.approx(
        float((short.force[0] * short.length).sum()), abs=1e-9
    )
    np.testing.assert_allclose(joined.time, short.time, atol=1e-9)
    apart = simulate(model, joined).position - simulate(model, short).position
    # what is late is felt where the command rests, in longer steps; and a gear that keeps up comes half a step late
    assert np.degrees(np.abs(apart).max()) < {"thruster-lag": 0.05, "input-delay": 0.05, "rudder-rate": 0.8}.get(
        name, 0.02
    )
