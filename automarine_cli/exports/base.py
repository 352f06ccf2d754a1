"""What a target of an export is.

Ours: I_r r' = tau - k_r r - k_rr |r| r with both coefficients positive, I_r the sum of rigid and added inertia.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from automarine_cli import __version__, effects
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.models.model import Model
from automarine_cli.models.store import ModelFile
from automarine_cli.thrusters.map import ThrusterMap

FRAME_AXES = {"NED": "NED world, body x ahead, y starboard, z down", "ENU": "ENU world, body x ahead, y port, z up"}
SENSES = {"NED": "from north, positive clockwise", "ENU": "from east, positive anticlockwise"}
DRAGS = ("linear-drag", "quadratic-drag")
FORCE_LETTERS = "XYZKMN"
"""Of the six motions: the letter of force or moment (SNAME 1950)."""


@dataclass(frozen=True)
class Options:
    """The user's numbers; each target says in `uses` which of them mean something to it.

    `rigid_inertia` is the vehicle's own part of I_r, in the file's unit, `rigid_mass` [kg] its mass;
    `newton_metres_per_nu` the size of the logs' normalised moment unit, both of these by motion where a file has
    several; `n_max` the largest control signal; `arm` [m] how far off the centre line two thrusters push ahead; `lag`
    [s] a propeller's time constant."""

    rigid_inertia: Any = None
    rigid_mass: float | None = None
    newton_metres_per_nu: Any = None
    symmetrise: bool = False
    n_max: float | None = None
    arm: float | None = None
    lag: float | None = None
    allow_partial: bool = False


@dataclass(frozen=True)
class Unsupported:
    name: str
    why: str

    def __str__(self) -> str:
        return f"Left out: {self.name}: {self.why}."


@dataclass(frozen=True)
class ModelOrigin:
    """The file that a model came from: its name, its hash, and which of its models was taken."""

    file: str
    sha256: str
    number: str = ""

    def __str__(self) -> str:
        which = f", model {self.number}" if self.number else ""
        return f"{self.file}{which} (sha256 {self.sha256[:16]})"


@dataclass(frozen=True)
class Subject:
    """What is to be written in a `frame` and a `form`, and what of it the target does not carry."""

    origins: tuple[ModelOrigin, ...]
    frame: str
    form: str
    settings: Options
    left_out: tuple[Unsupported, ...]

    @property
    def origin(self) -> ModelOrigin:
        return self.origins[0]

    def headed(self, lines: Iterable[str]) -> list[str]:
        """Lines below the one that says where the file came from, in letters of ASCII alone."""
        every = (f"Written by automarine {__version__} from {', '.join(map(str, self.origins))}.", *lines)
        return [line.encode("ascii", "backslashreplace").decode("ascii") for line in every]


@dataclass(frozen=True)
class MotionSubject(Subject):
    """A model of one motion: already in the file's frame and moment unit, with what the target carries alone.

    `file` is what the model file holds, for a card; `logs` are name and hash of the logs it was fitted to, None where
    that is not known."""

    model: Model
    file: ModelFile | None = None
    logs: tuple[tuple[str, str], ...] | None = None

    @property
    def dof(self) -> Dof:
        return self.model.dof

    @property
    def values(self) -> dict[str, tuple[float, ...]]:
        return {term.name: term.values for term in self.model.terms}

    def value(self, effect: str) -> float:
        return self.values.get(effect, (0.0,))[0]

    def equation_of(self, effect: str) -> str:
        """An effect's equation in the letters of the motion and in letters of ASCII."""
        return plain(self.dof.fill(effects.get(effect).law_at(self.values[effect]).equation))

    @property
    def inertias(self) -> tuple[float, float]:
        """Rigid and added inertia; without `rigid_inertia` the total and nothing."""
        rigid = self.settings.rigid_inertia
        return (self.model.inertia, 0.0) if rigid is None else (rigid, self.model.inertia - rigid)

    @property
    def force(self) -> str:
        return FORCE_LETTERS[self.dof.number]

    @property
    def rate_unit(self) -> str:
        return f"{self.dof.units.base}/s"

    @property
    def unit(self) -> str:
        return plain(self.dof.unit_of("inertia", self.model.moment_unit))

    def about_inertia(self) -> str:
        (rigid, added), word = self.inertias, self.dof.words.inertia
        total = f"{word.capitalize()}: {self.dof.symbols.inertia} = {number(self.model.inertia)} {self.unit}"
        if self.settings.rigid_inertia is not None:
            return f"{total} = {number(rigid)} rigid (given) + {number(added)} added."
        place = f"stands in one place, as rigid; no added {word} beside it."
        return f"{total} is the identified total of rigid and added {word} and {place}"


@dataclass(frozen=True)
class MapSubject(Subject):
    """A thruster map; `full_scale` [N] is the largest thrust that was measured, None if not told."""

    map: ThrusterMap
    full_scale: float | None = None

    @property
    def places(self) -> tuple[float, ...]:
        """How far to the positive side [m] of the frame the port and the starboard thruster are; none if not told."""
        arm, side = self.settings.arm, -1.0 if self.frame == "NED" else 1.0
        return () if arm is None else (side * arm, -side * arm)

    def about_places(self) -> str:
        if not self.places:
            return "where they are was not told (give --arm METRES of two that push ahead)"
        return f"port at y = {number(self.places[0])} m, starboard at y = {number(self.places[1])} m"


@dataclass(frozen=True)
class Written:
    text: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Several:
    """What a target makes of several motions together: forms with endings, the effects that it then carries (none: as
    of one), and whether it `couples` them, as a planar model does, and has `thrusters`."""

    forms: Mapping[str, str]
    carries: frozenset[str] = frozenset()
    couples: bool = False
    thrusters: bool = False


@dataclass(frozen=True)
class Target:
    """One simulator or paper.

    `forms` by name with the ending of the file, the first for who asks for none; `frames` likewise. `carries` the
    effects it has terms for, `in_plane` those of them in surge, sway and yaw alone, `lacks` the laws of them that it
    has none for; `varying` whether also effects that differ from run to run. `si` whether moments must be newton
    metres; `uses` the settings that mean something; `motions` those whose models it takes (none: thruster maps),
    `several` how it takes motions together (None: not at all)."""

    name: str
    says: str
    forms: Mapping[str, str]
    write: Callable[[Any], Written]
    frames: tuple[str, ...] = ("NED", "ENU")
    carries: frozenset[str] = frozenset(DRAGS)
    in_plane: frozenset[str] = frozenset()
    lacks: frozenset[tuple[str, int]] = frozenset()
    si: bool = True
    uses: frozenset[str] = frozenset({"rigid_inertia", "rigid_mass", "newton_metres_per_nu", "arm"})
    varying: bool = False
    motions: tuple[str, ...] = tuple(DOFS)
    several: Several | None = None


def joined(names: Sequence[str]) -> str:
    """Names in a row, the last after "and"."""
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)


def plain(text: str) -> str:
    return text.replace("²", "^2").replace("³", "^3")


def number(value: float) -> str:
    """A number in a file: eight digits, far below any standard error."""
    return f"{value + 0.0:.8g}"  # no minus zero


def row(values: Iterable[float], between: str = " ") -> str:
    return between.join(number(value) for value in values)


def frame_in_words(frame: str, dof: Dof) -> str:
    """A frame, and which way the motion is positive in it."""
    to = dof.words.to_ways[mirrored(dof) and frame == "ENU"]
    return f"{FRAME_AXES[frame]}: {dof.name} {f'{SENSES[frame]} seen from above' if dof.wraps else f'positive {to}'}"


def mirrored(dof: Dof) -> bool:
    """Whether the motion is positive the other way in ENU: only what is along x or about it is not."""
    return dof.number % 3 != 0


def head(subject: MotionSubject | MapSubject, equation: str, notes: Iterable[str]) -> list[str]:
    """What every file begins with: where it came from, equation, frame, units, notes; letters of ASCII only."""
    dof = subject.dof if isinstance(subject, MotionSubject) else YAW
    lines = [f"Equation: {equation}", f"Frame: {frame_in_words(subject.frame, dof)}."]
    if isinstance(subject, MotionSubject):
        unit, words = subject.model.moment_unit, subject.dof.words
        units = f"{words.force} {unit}, {words.speed} {subject.rate_unit}, {words.inertia} {subject.unit}"
        lines += [f"Units: {units}.", *map(str, subject.left_out)]
    return subject.headed((*lines, *notes))


def filled(template: str, fields: Mapping[str, object]) -> str:
    text = files("automarine_cli.exports").joinpath("templates", f"{template}.txt").read_text(encoding="utf-8")
    return text.format_map(fields)


def comment(lines: Iterable[str], sign: str = "") -> str:
    """Lines after a sign each, or in one comment of XML; two hyphens, which would end that, are set apart."""
    if sign:
        return "".join(f"{sign} {line}\n" for line in lines)
    inside = "".join(f"  {re.sub('-(?=-)', '- ', line)}\n" for line in lines)
    return f"<!--\n{inside}-->\n"
