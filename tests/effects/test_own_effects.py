"""Effects that are not of the library: registered by a script, or brought by an installed package."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from repository import SAMPLE_RUNS

from automarine_cli import effects
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.commands.validate import validate
from automarine_cli.effects import Effect, Parameter, Place, State
from automarine_cli.errors import ModelError
from automarine_cli.pipeline.results_folder import read_manifest
from automarine_cli.quantities import Floats

ROOT = Path(__file__).parents[2]
PACKAGE = """from automarine_cli.effects import Effect, Parameter, Place


class Mine(Effect):
    name = "mine"
    place = Place.MOMENT
    parameters = (Parameter("k", "push", "{force}", 0.0, 9.0, 0.1),)
    equation, says, reveals = "k", "Something pushes.", "any run"
    mistaken_for, separated_by, source = (), "nothing", "mine"

    def moment(self, state, values):
        return values[0] + 0.0 * state.velocity
"""


class Push(Effect):
    """A push."""

    name = "push"
    place = Place.MOMENT
    parameters = (Parameter("k", "push", "{force}", 0.0, 9.0, 0.1),)
    equation, says, reveals = "k", "Something pushes.", "any run"
    mistaken_for, separated_by, source = ("bias-moment",), "nothing", "mine"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return values[0] + 0.0 * state.velocity


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The library with a push in it, for one test."""
    monkeypatch.setattr(effects, "_REGISTERED", {})
    effects.look_alikes("bias-moment")  # what was looked up before does not stay
    effects.register(Push)
    yield
    effects.look_alikes.cache_clear()


@pytest.mark.usefixtures("registered")
def test_a_registered_effect_is_of_the_library() -> None:
    assert "push" in effects.names() and isinstance(effects.get("push"), Push)
    assert "push" in effects.look_alikes("bias-moment")
    for name in ("push", "dead-band", "learned:depth"):
        with pytest.raises(ModelError, match="is in the library already; give yours a new name"):
            effects.register(type("Again", (Push,), {"name": name}))


@pytest.mark.usefixtures("registered")
def test_manifests_list_its_file(tmp_path: Path) -> None:
    logs = sorted((SAMPLE_RUNS / "steps").glob("*.csv"))
    fit_yaw(logs, out=tmp_path / "fit")
    validate(logs[:2], model=tmp_path / "fit" / "yaw_model.json", out=tmp_path / "out", figures=False)
    entries = read_manifest(tmp_path / "out" / "manifest.json").inputs
    assert [entry.file for entry in entries if entry.role == "own_effect"] == [Path(__file__).name]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("", "", ""),
        ('"mine"\n    place', '"yours"\n    place', "expected a subclass of Effect of that name"),
        ("class Mine(Effect)", "class Mine(", "SyntaxError"),
        ("class Mine(Effect)", "class Other(Effect)", "AttributeError"),
    ],
)
def test_a_package_brings_one(old: str, new: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "my_package.py").write_text(PACKAGE.replace(old, new, 1))
    installed = tmp_path / "my_package-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("[automarine.effects]\nmine = my_package:Mine\n")
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    command = [sys.executable, "-m", "automarine_cli", "effects", "mine"]
    done = subprocess.run(command, capture_output=True, text=True, env=env, check=False)
    if said:
        assert done.returncode == 1 and said in done.stderr and "Traceback" not in done.stderr
        assert done.stderr.startswith("Error: effect 'mine' of the entry point my_package:Mine: ")
    else:
        assert (done.returncode, done.stderr) == (0, "") and "Something pushes." in done.stdout
