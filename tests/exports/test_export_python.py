"""`automarine export --to python`: the file alone, run in another process, moves as our own simulation does."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

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
from automarine_cli.exports.python import CARRIES, definitions
from automarine_cli.models.yaw_model import YawModel, response
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

Floats = NDArray[np.float64]
RUNNER = """
import importlib.util, sys
import numpy as np
for line in open(sys.argv[1], encoding="utf-8").read().splitlines():
    made, given, out = line.split("|")
    spec = importlib.util.spec_from_file_location("made", made)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    data = np.load(given)
    np.save(out, module.simulate(data["time"], data["tau"], float(data["psi0"]), 0.0))
"""
HEADING = 0.7  # rad, of every start
CLOSE = np.deg2rad(0.2)  # the file's steps are fixed, and a delayed command begins within one of them
PLAN = [(0.2, 3.0), (1.0, 2.5), (-0.7, 4.0), (0.0, 4.0)]


@dataclass(frozen=True)
class Trial:
    """A model, the moment's unit of its file, and the frame to export in."""

    name: str
    model: YawModel
    frame: str


def planted(name: str, law: int = 0) -> YawModel:
    """The paper's vehicle with one effect at a size that shows, in one of its laws."""
    return base_for(name).with_effect(name, sizes_of(effects.get(name), law))


def many() -> YawModel:
    model = planted("dead-band")
    for name in ("thruster-lag", "bias-moment", "water-swirl", "compass-deviation"):
        model = model.with_effect(name, sizes_of(effects.get(name)))
    return model


def trials() -> list[Trial]:
    """Every law of every effect that the file can have, each effect in both frames, and many together."""
    models = {f"{name} {law}": planted(name, law) for name in CARRIES for law in range(laws_of(effects.get(name)))}
    models["many"] = many()
    curve = [0.0, 4.0, 1.2, 1.0, *np.linspace(-0.1, 0.2, KNOTS), 1.0]  # a gain on the thrust
    models |= {f"curve {i}": base_for("none").with_effect(f"learned:{x}", curve) for i, x in ((1, "yaw-rate"),
               (2, "turned-angle"), (3, "heading"), (4, "time-in-run"))}  # fmt: skip
    frames = {name: ("NED",) if name[-1] in "123456" else ("NED", "ENU") for name in models}  # laws mirror alike
    return [Trial(f"{name} {frame}", models[name], frame) for name in models for frame in frames[name]]


def model_file(model: YawModel, path: Path) -> Path:
    number = "1" if model.terms[0].name == "linear-drag" else "3"
    drag = {"1": "k_r", "3": "k_rr"}[number]
    added = [
        {"name": t.name, "parameters": dict(zip(effects.get(t.name).names_in(model.dof), t.values))}
        for t in model.terms[1:]
    ]
    base = {"I_r": model.inertia, drag: model.terms[0].values[0]}
    content = {"schema": "automarine/yaw-model/1", "moment_unit": model.moment_unit, "models": {number: base}}
    path.write_text(json.dumps(content | {"preferred": number, "effects": added}))
    return path


def simulated(model: YawModel, run: Run) -> tuple[Floats, Floats]:
    """Our own headings and rates, with commands that change at the samples as the file takes them."""
    batch = make_batch([run], 0.02)
    start = Start(position=HEADING, switch_delay=0.499 * batch.interval[None])
    found = simulate(model, batch, start=start)
    return found.position[0, 0], found.velocity[0, 0]


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Floats]:
    """What the files of all trials make of the plan, by name: headings and rates in NED, (2, N)."""
    folder = tmp_path_factory.mktemp("made")
    jobs: list[tuple[Trial, Path]] = []
    lines = []
    run = unmeasured(PLAN, 0)
    for frame, sign, psi0 in (("NED", 1.0, HEADING), ("ENU", -1.0, np.pi / 2 - HEADING)):
        np.savez(folder / f"{frame}.npz", time=run.time, tau=sign * run.command, psi0=psi0)
    for i, trial in enumerate(trials()):
        made, out = folder / f"made_{i}.py", folder / f"out_{i}.npy"
        export(model_file(trial.model, folder / f"{i}.json"), to="python", frame=trial.frame, out=made)
        lines.append(f"{made}|{folder / f'{trial.frame}.npz'}|{out}")
        jobs.append((trial, out))
    (folder / "jobs.txt").write_text("\n".join(lines), encoding="utf-8")
    (folder / "runner.py").write_text(RUNNER)
    done = subprocess.run(
        [sys.executable, "-W", "error", str(folder / "runner.py"), str(folder / "jobs.txt")],
        capture_output=True, text=True, check=False, cwd=folder, env={"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = {}
    for trial, out in jobs:
        psi, r = np.load(out)
        found[trial.name] = np.array([np.pi / 2 - psi, -r]) if trial.frame == "ENU" else np.array([psi, r])
    return found


@pytest.mark.parametrize("trial", trials(), ids=lambda trial: trial.name)
def test_the_file_moves_as_we_do(trial: Trial, moved: dict[str, Floats]) -> None:
    heading, rate = simulated(trial.model, unmeasured(PLAN, 0))
    found = moved[trial.name]
    assert np.max(np.abs(found[0] - heading)) < CLOSE
    assert np.max(np.abs(found[1] - rate)) < 0.01 * np.max(np.abs(rate))


def test_the_plain_model_is_the_closed_form(moved: dict[tuple[str, int], Floats], tmp_path: Path) -> None:
    out = tmp_path / "made.py"
    export(model_file(base_for("none"), tmp_path / "yaw_model.json"), to="python", out=out)
    time = np.arange(0.0, 8.0, 0.1)
    given, result = tmp_path / "given.npz", tmp_path / "out.npy"
    np.savez(given, time=time, tau=np.full(len(time), -0.8), psi0=0.0)
    (tmp_path / "jobs.txt").write_text(f"{out}|{given}|{result}")
    (tmp_path / "runner.py").write_text(RUNNER)
    subprocess.run([sys.executable, str(tmp_path / "runner.py"), str(tmp_path / "jobs.txt")], check=True)
    expected = response(time, np.full(len(time), -0.8), INERTIA, 0.0, K_RR, 0.0, 0.0)[0]
    np.testing.assert_allclose(np.load(result)[0], expected, atol=1e-6)


def test_files_hold_what_acts_and_nothing_else(tmp_path: Path) -> None:
    for i, trial in enumerate(trials()):
        text = export(model_file(trial.model, tmp_path / f"{i}.json"), to="python", frame=trial.frame).text
        assert not any(line != line.rstrip() for line in text.splitlines()), trial.name
        assert "automarine_cli" not in text and "mistaken_for" not in text and "def in_enu" not in text


def test_no_two_effects_define_the_same_name() -> None:
    """Their sources stand in one file."""
    modules = {type(effects.get(name)).__module__ for name in CARRIES} | {base.__name__, Learned.__module__}
    every = [name for module in modules for name in definitions(sys.modules[module])]
    assert len(every) == len(set(every))


@pytest.mark.parametrize("name", effects.names())
def test_a_mirror_twice_is_nothing(name: str) -> None:
    model = base_for(name).with_effect(name, sizes_of(effects.get(name)))
    once = in_enu(model)
    assert in_enu(once) == model
    same = effects.get(name).parity == EVEN or name == "thruster-imbalance"  # a thruster is the same in any frame
    assert (once == model) == same


NEEDS = {
    "cross-coupling": ((0.4,), "it needs the logged surge"),
    "current-deviation": ((0.06, 0.04, 1.0), "it acts on the reading, not on the vehicle"),
    "voltage-exponent": ((1.2, 12.0), "it needs the logged voltage"),
    "thruster-dead-band": ((0.05,), "it needs the logged n_port, n_stbd"),
    "thruster-imbalance": ((0.1, 0.1, 0.0), "it needs the logged n_port, n_stbd"),
    "thruster-limit": ((0.5,), "it needs the logged n_port, n_stbd"),
    "periodic-disturbance": ((0.1, 0.0, 3.0, 1.0), "it differs from run to run"),
}


def test_every_effect_is_in_the_file_or_has_its_reason() -> None:
    assert set(CARRIES) | set(NEEDS) == set(effects.names())


@pytest.mark.parametrize("name", NEEDS)
def test_what_a_file_cannot_know_is_refused(tmp_path: Path, name: str) -> None:
    values, why = NEEDS[name]
    path = model_file(base_for(name).with_effect(name, values), tmp_path / "yaw_model.json")
    with pytest.raises(SettingError) as problem:
        export(path, to="python")
    sentence = f"yaw_model.json: python cannot represent {name} ({why}); give --allow-partial to write the file without"
    assert str(problem.value) == sentence
    assert export(path, to="card").left_out == ()
