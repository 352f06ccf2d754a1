"""`automarine export --to python`: the file alone, run in another process, moves as our own simulation does."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from effect_contract import base_for, laws_of, sizes_of, unmeasured
from made_runs import INERTIA, K_RR
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.commands.export import export
from automarine_cli.effects import base
from automarine_cli.effects.base import EVEN
from automarine_cli.effects.learned import KNOTS, Learned
from automarine_cli.errors import SettingError
from automarine_cli.exports.export import in_enu
from automarine_cli.exports.python import PYTHON_EFFECTS, STEERING, TARGET, definitions
from automarine_cli.models.model import Model, response
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

Floats = NDArray[np.float64]
RUNNER = """
import importlib.util, sys
import numpy as np
for line in open(sys.argv[1], encoding="utf-8").read().splitlines():
    file, commands, out = line.split("|")
    spec = importlib.util.spec_from_file_location("file", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    data = np.load(commands)
    np.save(out, module.simulate(data["time"], data["tau"], float(data["psi0"]), 0.0))
"""
HEADING = 0.7  # rad, of every start
CLOSE = np.deg2rad(0.2)  # the file's steps are fixed, and a delayed command begins within one of them
PLAN = [(0.2, 1.0), (1.0, 1.5), (-0.7, 2.0), (0.0, 1.5)]


def planted(name: str, law: int = 0) -> Model:
    """The paper's vehicle with one effect at a size that shows, in one of its laws."""
    return base_for(name).with_effect(name, sizes_of(effects.get(name), law))


def many() -> Model:
    model = planted("dead-band")
    for name in ("thruster-lag", "bias-moment", "water-swirl", "compass-deviation"):
        model = model.with_effect(name, sizes_of(effects.get(name)))
    return model


def trials() -> dict[tuple[str, str], Model]:
    """By name and frame: every law of every effect that the file can have, each in both frames, and many together."""
    of_yaw = [name for name in PYTHON_EFFECTS if effects.get(name).role != "restoring"]
    laws = ((name, law) for name in of_yaw for law in range(laws_of(effects.get(name))))
    models = {f"{name} {law}": planted(name, law) for name, law in laws if (name, law) not in TARGET.lacks}
    models["many"] = many()
    curve = [0.0, 4.0, 1.2, 1.0, *np.linspace(-0.1, 0.2, KNOTS), 1.0]  # a gain on the thrust
    models |= {f"curve {i}": base_for("none").with_effect(f"learned:{x}", curve) for i, x in ((1, "yaw-rate"),
               (2, "turned-angle"), (3, "heading"), (4, "time-in-run"))}  # fmt: skip
    frames = {name: ("NED",) if name[-1] in "123456" else ("NED", "ENU") for name in models}  # laws mirror alike
    return {(name, frame): models[name] for name in models for frame in frames[name]}


TRIALS = trials()


def model_file(model: Model, path: Path) -> Path:
    base, *more = model.terms
    number, drag = ("1", "k_r") if base.name == "linear-drag" else ("3", "k_rr")
    names = {term.name: effects.get(term.name).names_in(model.dof) for term in more}
    added = [{"name": term.name, "parameters": dict(zip(names[term.name], term.values))} for term in more]
    models = {number: {"I_r": model.inertia, drag: base.values[0]}}
    content = {"schema": "automarine/yaw-model/1", "moment_unit": model.moment_unit, "models": models}
    path.write_text(json.dumps(content | {"preferred": number, "effects": added}))
    return path


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], str]:
    """The files of all trials."""
    path = tmp_path_factory.mktemp("models") / "yaw_model.json"
    return {
        (name, frame): export(model_file(model, path), to="python", frame=frame).text
        for (name, frame), model in TRIALS.items()
    }


@pytest.fixture(scope="module")
def moved(texts: dict[tuple[str, str], str], tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Floats]:
    """What the files of all trials, and of the plain model, make of the plan: headings and rates in NED, (2, N)."""
    folder = tmp_path_factory.mktemp("files")
    run = unmeasured(PLAN, 0)
    for frame, sign, psi0 in (("NED", 1.0, HEADING), ("ENU", -1.0, np.pi / 2 - HEADING)):
        np.savez(folder / f"{frame}.npz", time=run.time, tau=sign * run.command, psi0=psi0)
    for i, text in enumerate(texts.values()):
        (folder / f"file_{i}.py").write_text(text)
    lines = [f"file_{i}.py|{frame}.npz|out_{i}.npy" for i, (_, frame) in enumerate(texts)]
    (folder / "jobs.txt").write_text("\n".join(lines), encoding="utf-8")
    (folder / "runner.py").write_text(RUNNER)
    subprocess.run(
        [sys.executable, "-W", "error", "runner.py", "jobs.txt"],
        check=True,
        cwd=folder,
        env={"OPENBLAS_NUM_THREADS": "1"},
    )
    positions = {}
    for i, (name, frame) in enumerate(texts):
        psi, r = np.load(folder / f"out_{i}.npy")
        positions[name, frame] = np.array([np.pi / 2 - psi, -r]) if frame == "ENU" else np.array([psi, r])
    return positions


@pytest.mark.parametrize("trial", TRIALS, ids=" ".join)
def test_the_file_moves_as_we_do(trial: tuple[str, str], moved: dict[tuple[str, str], Floats]) -> None:
    """Under commands that change at the samples, as the file takes them."""
    batch = make_batch([unmeasured(PLAN, 0)], 0.02)
    start = Start(position=HEADING, switch_delay=0.499 * batch.interval[None])
    expected = simulate(TRIALS[trial], batch, start=start)
    heading, rate = expected.position[0, 0], expected.velocity[0, 0]
    assert np.max(np.abs(moved[trial][0] - heading)) < CLOSE
    assert np.max(np.abs(moved[trial][1] - rate)) < 0.01 * np.max(np.abs(rate))


def test_the_plain_model_is_the_closed_form(tmp_path: Path) -> None:
    space: dict[str, Any] = {}
    exec(export(model_file(base_for("none"), tmp_path / "yaw_model.json"), to="python").text, space)
    time = np.arange(0.0, 8.0, 0.1)
    moment = np.full(len(time), -0.8)
    expected = response(time, moment, INERTIA, 0.0, K_RR)[0]
    np.testing.assert_allclose(space["simulate"](time, moment)[0], expected, atol=1e-6)


def test_files_hold_what_acts_and_nothing_else(texts: dict[tuple[str, str], str]) -> None:
    for trial, text in texts.items():
        assert not any(line != line.rstrip() for line in text.splitlines()), trial
        assert "automarine_cli" not in text and "mistaken_for" not in text and "def in_enu" not in text


def test_no_two_effects_define_the_same_name() -> None:
    """Their sources stand in one file."""
    modules = {type(effects.get(name)).__module__ for name in PYTHON_EFFECTS} | {base.__name__, Learned.__module__}
    names = [name for module in modules for name in definitions(sys.modules[module])]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name", effects.names())
def test_a_mirror_twice_is_nothing(name: str) -> None:
    model = base_for(name).with_effect(name, sizes_of(effects.get(name)))
    once = in_enu(model)
    assert in_enu(once) == model
    same = effects.get(name).parity == EVEN or name == "thruster-imbalance"  # a thruster is the same in any frame
    assert (once == model) == same


NEEDS = {
    "current-deviation": ((0.06, 0.04, 1.0), "it acts on the reading, not on the vehicle"),
    "rudder-offset": ((0.1,), "it needs the logged rudder"),
    "rudder-race": ((0.4,), "it needs the logged rudder, force_X"),
    "rudder-rate": ((0.3,), "it needs the logged rudder"),
    "rudder-stall": ((0.5, 0.5), "it needs the logged rudder"),
    "voltage-exponent": ((1.2, 12.0), "it needs the logged voltage"),
    "thruster-dead-band": ((0.05,), "it needs the logged n_port, n_stbd"),
    "thruster-imbalance": ((0.1, 0.1, 0.0), "it needs the logged n_port, n_stbd"),
    "thruster-limit": ((0.5,), "it needs the logged n_port, n_stbd"),
    "periodic-disturbance": ((0.1, 0.0, 3.0, 1.0), "it differs from run to run"),
}


def test_every_effect_is_in_the_file_or_has_its_reason() -> None:
    assert set(PYTHON_EFFECTS) | STEERING | set(NEEDS) == set(effects.names())


@pytest.mark.parametrize("name", NEEDS)
def test_what_a_file_cannot_know_is_refused(tmp_path: Path, name: str) -> None:
    values, why = NEEDS[name]
    path = model_file(base_for(name).with_effect(name, values), tmp_path / "yaw_model.json")
    with pytest.raises(SettingError, match=rf"^yaw_model\.json: .* {name} \({why}\); give --allow-partial to write"):
        export(path, to="python")
    assert export(path, to="card").left_out == ()
