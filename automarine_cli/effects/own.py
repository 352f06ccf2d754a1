"""Effects of the user's own: files like those of this folder, in a folder of theirs.

That folder is the one that the environment variable AUTOMARINE_EFFECTS names, else `automarine/effects` among the
user's settings. A file there is named after its effect, as in the library, and is code that is run: only what the user
put there, by `automarine effects --new FILE.py` or by hand, and only when effects are looked at.
"""

import hashlib
import importlib.util
import os
from functools import cache
from pathlib import Path

import numpy as np

from automarine_cli.dofs import DOFS
from automarine_cli.effects.base import Commands, Effect, Place, State
from automarine_cli.errors import ModelError
from automarine_cli.quantities import Floats

VARIABLE = "AUTOMARINE_EFFECTS"
SETS, RUNS, STEPS = 3, 4, 5
"""Parameter sets, runs and steps on which an effect is tried."""
TEXTS = ("equation", "says", "reveals", "separated_by", "source")


def own_folder() -> Path:
    """The folder of the user's own effects, there or not."""
    told = os.environ.get(VARIABLE)
    if told:
        return Path(told)
    settings = os.environ.get("XDG_CONFIG_HOME")
    return (Path(settings) if settings else Path.home() / ".config") / "automarine" / "effects"


def own_files() -> dict[str, Path]:
    """The files of the user's own effects by the effects' names, sorted; nothing is run."""
    folder = own_folder()
    found = sorted(folder.glob("*.py")) if folder.is_dir() else []
    return {path.stem.replace("_", "-"): path for path in found if not path.stem.startswith("_")}


def own_effect(path: Path) -> Effect:
    """The effect in a file, which is run; it was tried and keeps the contract. Raises ModelError in one sentence."""
    return _loaded(path, hashlib.sha256(path.read_bytes()).hexdigest())


@cache
def _loaded(path: Path, _: str) -> Effect:
    """The effect in a file of that content."""
    specification = importlib.util.spec_from_file_location(f"own_effect_{path.stem}", path)
    if specification is None or specification.loader is None:
        raise ModelError(f"{path.name}: is no file of Python; expected an effect like those of the library")
    module = importlib.util.module_from_spec(specification)
    try:
        specification.loader.exec_module(module)
    except Exception as problem:  # whatever the user's code may raise
        raise ModelError(f"{path.name}: cannot be run: {type(problem).__name__}: {problem}") from None
    classes = [
        c for c in vars(module).values()
        if isinstance(c, type) and issubclass(c, Effect) and c.__module__ == module.__name__
    ]  # fmt: skip
    if len(classes) != 1:
        raise ModelError(f"{path.name}: holds {len(classes)} subclasses of Effect; expected one")
    try:
        effect: Effect = classes[0]()
        why = broken(effect, path.stem.replace("_", "-"))
    except Exception as problem:
        why = f"{type(problem).__name__}: {problem}"
    if why:
        raise ModelError(f"{path.name}: breaks the contract of an effect: {why}")
    return effect


def broken(effect: Effect, name: str) -> str:
    """How an effect that should have that name breaks the contract of an effect; empty where it keeps it."""
    if effect.name != name:
        return f"its name is {effect.name!r}; a file of that name holds {name!r}"
    if not isinstance(effect.place, Place):
        return f"its place is {effect.place!r}; expected one of Place"
    for text in TEXTS:
        if not isinstance(getattr(effect, text, None), str) or not getattr(effect, text):
            return f"it has no {text}; expected a sentence"
    if not effect.parameters or not effect.motions:
        return "it has no parameters or acts in no motion"
    for dof in DOFS.values():
        if effect.acts_in(dof):
            effect.card(dof)  # templates that nothing fills raise
    for one in effect.parameters:
        if not one.lower <= one.start <= one.upper:
            return f"parameter {one.name} starts at {one.start:g}, outside {one.lower:g} to {one.upper:g}"
    return _off_does_something(effect) or _not_vectorised(effect)


def _off_does_something(effect: Effect) -> str:
    """An effect that is off leaves everything as it was, to the last bit."""
    values = tuple(np.full((SETS, 1), value) for value in effect.off)
    for what, (before, after) in _tried(effect, values).items():
        if not np.array_equal(np.broadcast_to(after, np.shape(before)), before):
            return f"with every parameter off it still changes the {what}"
    return ""


def _not_vectorised(effect: Effect) -> str:
    """Parameter sets together do what each does alone, and stay finite."""
    rows = [[p.start * (1.0 + 0.1 * i) for i in range(SETS)] for p in effect.parameters]
    ends = [(p.lower, p.upper) for p in effect.parameters]
    values = tuple(
        np.array([p.start] * SETS if p.held else np.clip(row, *end))[:, None]
        for p, row, end in zip(effect.parameters, rows, ends)
    )
    together = _tried(effect, values)
    for what, (before, after) in together.items():
        whole = np.broadcast_shapes(np.shape(before), np.shape(after))
        if whole != np.shape(before):
            return f"the {what} has shape {np.shape(after)} where {np.shape(before)} is expected"
        if not np.all(np.isfinite(after)):
            return f"the {what} is not finite at the parameters' starts"
        for i in range(SETS):
            alone = _tried(effect, tuple(value[i : i + 1] for value in values))[what][1]
            left, right = (np.broadcast_to(one, np.shape(before))[i] for one in (after, alone))
            if not np.allclose(left, right, rtol=1e-12, atol=1e-12):
                return f"the {what} of several parameter sets together is not that of each alone"
    return ""


def _tried(effect: Effect, values: tuple[Floats, ...]) -> dict[str, tuple[Floats, Floats]]:
    """What an effect does on some made-up motion, by where it acts: without and with it."""
    random = np.random.default_rng(0)
    shape, wide = (SETS, RUNS), (SETS, RUNS, STEPS)
    columns = {name: random.uniform(0.5, 2.0, RUNS) for name in effect.needs}
    own = tuple(np.full(shape, 0.1) for _ in range(effect.per_run))
    if effect.place in (Place.MOMENT, Place.WATER):
        draw = [random.normal(size=shape) for _ in range(5)]
        flow = [draw[3]] * len(DOFS)
        stored = tuple(np.zeros(shape) for _ in effect.states)
        state = State(draw[0], draw[1], draw[2], draw[3], draw[4], np.full((RUNS,), 2.0), columns, flow, stored)
        moment = effect.moment(state, (*values, *own)) + effect.water_rate(stored, values)
        return {"moment": (np.zeros(shape), np.asarray(moment))}
    spread = tuple(value[..., None] for value in values)
    time = np.broadcast_to(0.1 * np.arange(STEPS), wide)
    if effect.place is Place.SENSOR:
        heading = random.normal(size=wide).cumsum(axis=2)
        return {"reading": (heading, np.asarray(effect.read(heading, time, spread)))}
    force = random.normal(size=wide)
    signals = {name: column[:, None] * np.ones(STEPS) for name, column in columns.items()}
    commands = Commands(force, time, np.full(wide, 0.1), np.zeros((RUNS, 1)), np.zeros((RUNS, 1)), signals)
    return {"thrust": (force, np.asarray(effect.deliver(commands, spread)))}
