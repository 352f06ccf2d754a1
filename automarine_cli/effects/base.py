"""What an effect is, and the recipe for writing the next one.

An effect is one term of the equation of motion, baseline drag and hidden disturbance alike:

    psi' = r,    I_r r' = tau_delivered + sum of moments,    reading = sensor(psi)

Recipe: one file in this folder, one subclass of `Effect`, which the registry and the contract test find by themselves:

1. `name` (with hyphens), `place`, `source`, and its texts, templates over `Dof.vocabulary`: `equation`, `says` (the
   verdict's sentence), `reveals` (the runs that show it), `mistaken_for` (names), `separated_by` (the run that tells
   them apart);
2. `parameters`, in the order in which the methods take them; with all at their off value the model is exactly the model
   without the effect;
3. one of `deliver` for actuators, `moment` for moments, `read` for sensors; `states` with `derivatives` where it has
   states of its own (a moment finds them in `stored`).

Every method is a pure function of arrays of shape (P, R), parameter sets by runs, or shapes that broadcast to it. An
effect acts on one degree of freedom and sees the state of that one, and the flow along the others.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from math import inf, nan
from typing import ClassVar

import numpy as np

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.quantities import Floats

EVEN, MIXED, ODD = "even", "mixed", "odd"
"""What a mirrored campaign (heading and command negated) does to an effect's parameters: it leaves them, turns some as
the mirrored equation says, or negates all."""
SINGLE, TOGETHER, SLOWLY = range(3)
"""When an actuator acts, whatever the order in which a model lists its terms: SINGLE thrusters first, then what happens
at once to what they give TOGETHER, at last what follows that SLOWLY."""


@dataclass(slots=True)
class State:
    """State of one degree of freedom of all runs under all parameter sets at one instant: arrays that broadcast to
    (P, R).

    `position` [rad or m, unwrapped, true], `origin` the same at the run's start, `velocity` over ground [per s],
    `relative` the velocity through the water, on which drag depends, `delivered` moment or force after the actuators,
    `time` in the run [s], `signals` other logged columns held over the step, `flow` the velocities through the water
    of all degrees of freedom that move together, by their place, `stored` the states of the effect that is asked for
    its moment. The simulator fills it in anew for every instant. In the plane `position` is north, east or the heading.
    """

    position: Floats
    origin: Floats
    velocity: Floats
    relative: Floats
    delivered: Floats
    time: Floats
    signals: Mapping[str, Floats]
    flow: Sequence[Floats] = ()
    stored: Sequence[Floats] = ()

    @property
    def travelled(self) -> Floats:
        return self.position - self.origin


@dataclass(frozen=True)
class Commands:
    """The commands of all runs on the simulation grid, for actuator effects.

    `force` (P, R, M), moment or force, is held over each of the M steps, `start` and `length` (P, R, M) [s] say when;
    `before` (R, 1) is what was held before the first sample, `clock` (R, 1) the campaign's clock [s] at the run's
    first sample; `signals` are other logged columns, (R, M).
    """

    force: Floats
    start: Floats
    length: Floats
    before: Floats
    clock: Floats
    signals: Mapping[str, Floats]


class Place(Enum):
    """Where an effect acts; the simulator applies the places in this order."""

    ACTUATOR = "actuator"
    MOMENT = "moment"
    WATER = "water"
    SENSOR = "sensor"


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect: name, meaning and unit (templates; see `Dof.unit_in`), bounds, start, and off value.

    `start` (and `scan`) are for a largest moment of one; `scaled` makes them fit other moments. A parameter with a
    `scan` shapes the effect and means nothing while the effect is off: fits start from the best of these values.
    `log` marks those searched on the logarithm. A parameter with a `reference` is not fitted but says against what the
    others are meant: "moment" the largest moment of the logs, "clock" their first instant, "voltage" their mean
    supply voltage. One with `choices` is not fitted either: its value counts in these words, laws of which nature has
    one, and a diagnosis tries them all; where it is not given it is the first. `laws` are the places of those choices
    in which a parameter counts, none for all; in other laws it is left as it is, and files may leave it out.
    """

    name: str
    meaning: str
    unit: str
    lower: float = -inf
    upper: float = inf
    start: float = 0.0
    off: float = 0.0
    scan: tuple[float, ...] = ()
    log: bool = False
    reference: str = ""
    choices: tuple[str, ...] = ()
    laws: tuple[int, ...] = ()

    @property
    def optional(self) -> bool:
        """Whether files may leave it out: it is then at its start."""
        return bool(self.choices or self.laws)

    @property
    def held(self) -> bool:
        return bool(self.reference or self.choices)

    def scaled(self, value: float, largest: float) -> float:
        power = 0.5 if self.unit.startswith("({force})^1/2") else 1.0 if "{force}" in self.unit else 0.0
        return float(value * largest**power)


def choice(name: str, meaning: str, words: str) -> Parameter:
    """Return the parameter that counts in these words, which semicolons part."""
    choices = tuple(words.split("; "))
    return Parameter(name, meaning, "1", 0.0, len(choices) - 1.0, choices=choices)


def reference(name: str, meaning: str, laws: tuple[int, ...] = ()) -> Parameter:
    """Return the parameter that is the largest moment of the logs."""
    return Parameter(name, meaning, "{force}", 0.0, start=1.0, reference="moment", laws=laws)


def multiple(name: str, meaning: str, laws: tuple[int, ...]) -> Parameter:
    """Return the parameter of some laws that is a multiple of another, about one."""
    return Parameter(name, meaning, "1", 0.05, 20.0, 1.0, scan=(0.4, 2.5), log=True, laws=laws)


@dataclass(frozen=True)
class Law:
    """A law of nature beside an effect's first one: its equation (a template), source, and look-alikes by name; where
    not given those of the effect."""

    equation: str
    source: str = ""
    mistaken_for: tuple[str, ...] = ()


@dataclass(frozen=True)
class Card:
    """An effect in the words, letters and units of a motion: what people read of it."""

    name: str
    equation: str
    says: str
    reveals: str
    separated_by: str
    parameters: tuple[Parameter, ...]
    laws: tuple[str, ...]

    @property
    def better(self) -> str:
        return f"To see {self.name} better: {self.reveals}."


class Effect:
    def __init_subclass__(cls) -> None:
        cls.laws = tuple(
            Law(law.equation, law.source or cls.source, law.mistaken_for or cls.mistaken_for) for law in cls.laws
        )

    name: ClassVar[str]
    place: ClassVar[Place] = Place.MOMENT
    parameters: ClassVar[tuple[Parameter, ...]]
    equation: ClassVar[str]
    says: ClassVar[str]
    reveals: ClassVar[str]
    mistaken_for: ClassVar[tuple[str, ...]]
    separated_by: ClassVar[str]
    source: ClassVar[str]
    laws: ClassVar[tuple[Law, ...]] = ()  # beside the first, in the order of the choices
    parity: ClassVar[str] = EVEN
    states: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[tuple[str, ...]] = ()  # signals that its methods read
    acts_on: ClassVar[str] = ""  # the signal on which an actuator acts where that is logged beside the commands
    steered: ClassVar[bool | None] = None  # whether the angle of a rudder has to be the command, or may not be it
    logged: ClassVar[tuple[str, ...]] = ()  # columns of which its signals are made, where they are none themselves
    stage: int = TOGETHER
    uses_position: ClassVar[bool] = False  # whether the moment depends on the position, else summed at the end
    uses_absolute: ClassVar[bool] = False  # whether on the very position, not only on the turn since the start
    per_run: ClassVar[int] = 0  # coefficients that each run may have of its own [force]; they come after the values
    role: ClassVar[str] = ""  # what its one parameter is in a motion's own equation, by `Dof.parameters`
    power: ClassVar[int | None] = None  # of the speed with which it resists; None for what is no drag
    remembers: ClassVar[bool] = False  # whether a sensor is slow, its first parameter the time [s]: see `remember`
    reads_force: ClassVar[bool] = False  # whether `read` gets the moment delivered after the values
    delays: ClassVar[bool] = False  # whether it makes commands late
    returning: ClassVar[bool] = False  # whether only commands that fall again tell it from a simpler effect
    rotational: ClassVar[bool] = False  # whether it acts on headings alone

    def acts_in(self, dof: Dof) -> bool:
        if self.acts_on:  # a rudder, or an elevator
            return dof.wraps or not dof.horizontal
        return dof.wraps or not self.rotational

    def needs_at(self, values: tuple[float, ...]) -> tuple[str, ...]:
        """Signals that it reads under the law that holds at these values."""
        return self.needs

    def laws_of(self, logged: Collection[str]) -> list[int]:
        """Places of its laws for which all signals are logged."""
        return [law for law in self.places if set(self.needs_at(self._starts(law))) <= set(logged)]

    def law_of(self, logged: Collection[str]) -> int:
        """The first of those; the first of all where there is none."""
        return next(iter(self.laws_of(logged)), 0)

    @property
    def places(self) -> range:
        """Places of its laws among the choices."""
        return range(max([1, *(len(p.choices) for p in self.parameters)]))

    def needs_of(self, logged: Collection[str]) -> tuple[str, ...]:
        """Signals that it reads under that law."""
        return self.needs_at(self._starts(self.law_of(logged)))

    def _starts(self, law: int) -> tuple[float, ...]:
        return tuple(float(law) if p.choices else p.start for p in self.parameters)

    def shifts(self, values: Sequence[float]) -> bool:
        """Whether it makes every command late by the same time, as a logger's convention does."""
        return self.delays

    def late(self, values: Sequence[float]) -> float:
        """Seconds by which it makes late what is seen of a command; not a number where it makes nothing late."""
        return nan

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns beyond time, position and command that a log must have."""
        return self.logged or self.needs

    @property
    def motions(self) -> tuple[str, ...]:
        return tuple(name for name, dof in DOFS.items() if self.acts_in(dof))

    def card(self, dof: Dof, force_unit: str = "") -> Card:
        """Its texts in a motion; without a unit of force that is called the force's unit."""
        unit = force_unit or f"{dof.words.force} unit"
        parameters = tuple(
            replace(p, name=dof.fill(p.name), meaning=dof.fill(p.meaning), unit=dof.unit_in(p.unit, unit))
            for p in self.parameters
        )
        equation, says, reveals, separated = map(dof.fill, (self.equation, self.says, self.reveals, self.separated_by))
        laws = tuple(dof.fill(law.equation) for law in self.laws)
        return Card(self.name, equation, says, reveals, separated, parameters, laws)

    def names_in(self, dof: Dof) -> tuple[str, ...]:
        """What a motion calls its parameters: their keys in files."""
        return tuple(dof.fill(parameter.name) for parameter in self.parameters)

    @property
    def shapes(self) -> tuple[bool, ...]:
        """Which parameters mean nothing while the effect is off: the held ones, and scanned ones beside a size."""
        sized = any(not p.scan and not p.held for p in self.parameters)
        return tuple(bool(p.held or (p.scan and sized)) for p in self.parameters)

    def held(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        """Which parameters a fit leaves as they are, at these values."""
        return tuple(p.held or not self.counts(p, values) for p in self.parameters)

    def placed(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        """Which parameters are edges, about which a likelihood is level where no command is near: fits leave them where
        they are, and a diagnosis tries places."""
        return (False,) * len(values)

    def law(self, values: Sequence[float]) -> int:
        """Which of its laws holds at these values: the place among the choices, 0 where there is one law only."""
        return next((round(value) for p, value in zip(self.parameters, values) if p.choices), 0)

    def law_at(self, values: Sequence[float]) -> Law:
        """The law that holds at these values, the first one with the effect's own equation and source."""
        law = self.law(values)
        return self.laws[law - 1] if 0 < law <= len(self.laws) else Law(self.equation, self.source, self.mistaken_for)

    def counts(self, parameter: Parameter, values: Sequence[float]) -> bool:
        """Whether a parameter means anything under the law that holds at these values."""
        return not parameter.laws or self.law(values) in parameter.laws

    def varies(self, values: tuple[float, ...]) -> bool:
        """Whether each run has coefficients of its own, at these values."""
        return False

    def lacking(self, names: Collection[str], values: Sequence[float], dof: Dof) -> str:
        """The first parameter that a file has to give and that is not among its `names`; empty for none."""
        pairs = zip(self.names_in(dof), self.parameters)
        return next((n for n, p in pairs if n not in names and not p.choices and self.counts(p, values)), "")

    def scan(self, parameter: Parameter, values: tuple[float, ...]) -> tuple[float, ...]:
        """Values at which fits of a parameter may start, given the choices in `values`."""
        return parameter.scan

    @property
    def off(self) -> tuple[float, ...]:
        """Values with which a model is exactly the model without the effect; shapes are at their start."""
        return tuple(p.start if shape else p.off for p, shape in zip(self.parameters, self.shapes))

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        """Moment delivered for the moment commanded, (P, R, M); actuators only."""
        return commands.force

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats | float:
        """Moment added to the equation of motion, (P, R), in the moment's unit."""
        return 0.0

    def foreknown(self, signals: Mapping[str, Floats], values: tuple[Floats, ...]) -> Floats | None:
        """What `moment` finds among the signals by the effect's name, (P, M, R), as logged columns (R, M) alone make it
        whatever the motion; None where there is no such thing."""
        return None

    def water_rate(self, states: tuple[Floats, ...], values: tuple[Floats, ...]) -> Floats | float:
        """Rate at which the water turns [rad/s], (P, R); water effects only."""
        return 0.0

    def derivatives(self, state: State, states: tuple[Floats, ...], values: tuple[Floats, ...]) -> tuple[Floats, ...]:
        """Time derivative of each of `states`, (P, R)."""
        return ()

    def read(self, heading: Floats, time: Floats, values: tuple[Floats, ...]) -> Floats:
        """Heading that the sensor reads for the true one, both (P, R, M) on the simulation grid [rad]."""
        return heading

    def remember(
        self, reading: Floats, before: Floats, after: Floats, length: Floats, values: tuple[Floats, ...]
    ) -> Floats:
        """What a sensor that remembers shows after a step of `length` [s] over which the truth went straight from
        `before` to `after`, when it showed `reading` at its beginning; arrays that broadcast to (P, R)."""
        return after


Deliver = Callable[[Commands, tuple[Floats, ...]], Floats]


def choose(law: Floats, *options: Callable[[], Floats]) -> Floats:
    """What each parameter set's law gives, in the shape to which `law` (P, ...) and the options broadcast; only options
    that some set asks for are worked out."""
    first = law.flat[0]
    if (law == first).all():
        return options[round(float(first))]()
    laws = np.unique(law)
    result = options[round(float(laws[0]))]()
    for number in laws[1:]:
        result = np.where(law == number, options[round(float(number))](), result)
    return result


def lagged(target: Floats, before: Floats, length: Floats, lag: Floats) -> tuple[Floats, Floats]:
    """Follow a `target` (P, R, M), held over steps of `length` [s], with the time constant `lag` [s], from `before`:
    what each step begins with, and the mean over each."""
    faded = -np.expm1(-length / lag)
    left, risen = (np.moveaxis(x, 2, 0).copy() for x in (1.0 - faded, target * faded))
    begun = np.empty(np.broadcast_shapes(left.shape, risen.shape))
    begun[:1] = before[..., 0]
    for m in range(1, len(begun)):
        begun[m] = left[m - 1] * begun[m - 1] + risen[m - 1]
    by_step = np.moveaxis(begun, 0, 2)
    return by_step, target + (by_step - target) * lag * faded / np.maximum(length, 1e-12)


def deliver_by_law(options: Sequence[Deliver], commands: Commands, values: tuple[Floats, ...], law: Floats) -> Floats:
    """What each parameter set's own law delivers, (P, R, M): every law sees the sets that ask for it, and no others."""
    law = np.round(law)  # whether fixed or aside for a derivative
    laws = np.unique(law)
    if len(laws) == 1:
        return options[round(float(laws[0]))](commands, values)
    if law.shape[1] > 1:  # runs with parameters of their own
        return choose(law, *(partial(option, commands, values) for option in options))
    shape = np.broadcast_shapes(commands.force.shape, commands.length.shape, law.shape)
    delivered = np.empty(shape)
    for number in laws:
        sets = np.broadcast_to(law, (shape[0], 1, 1))[:, 0, 0] == number

        def pick(x: Floats, sets: Floats = sets) -> Floats:
            return x[sets] if len(x) == len(sets) else x

        part = replace(commands, force=pick(commands.force), start=pick(commands.start), length=pick(commands.length))
        delivered[sets] = options[round(float(number))](part, tuple(pick(value) for value in values))
    return delivered
