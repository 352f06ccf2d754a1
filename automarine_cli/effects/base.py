"""What an effect is, and the recipe for writing the next one.

An effect is one term of the equation of motion, baseline drag and hidden disturbance alike:

    psi' = r,    I_r r' = tau_delivered + sum of moments,    reading = sensor(psi)

Recipe: one file in this folder, one subclass of `Effect` with

1. `name` (the contract's name, with hyphens), `place`, `equation`, `says` (the verdict's sentence), `reveals` (the runs
   that show it), `mistaken_for` (names) and `separated_by` (the run that tells them apart), `source`;
2. `parameters`, in the order in which the methods take them, each with unit, bounds, start, and the value at
   which the effect is off, so that the model with the effect switched off is exactly the model without it;
3. one of the methods: `deliver` for actuators, `moment` for moments, `read` for sensors; and `states` with
   `derivatives` where it carries states of its own (a moment finds them in `stored`); `steered = True` where the
   moment depends on the heading, `placed = True` where it does on the very heading and not on the turn since the
   start, `power` where it is drag; `acts_in` where it needs a motion of some kind.

Texts are templates over the vocabulary of a degree of freedom (`Dof.vocabulary`), such as "-{quadratic} |{v}| {v}" or
"A constant {force} acts on the vehicle."; `card` fills them. An effect that acts in one motion only may say it plainly.

The folder is the registry: `effects.get("my-effect")` and the contract test find the new file by themselves.
Every method is a pure function of arrays of shape (P, R), parameter sets by runs, or shapes that broadcast
to it. An effect acts on one degree of freedom and sees the state of that one, and the flow along the others.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.effects.inputs import Commands, State

__all__ = [
    "EVEN", "MIXED", "ODD", "Card", "Commands", "Effect", "Floats", "Law", "Parameter", "ParameterCard", "Place",
    "State",
]  # fmt: skip
from automarine_cli.quantities import Floats

EVEN = "even"
"""A mirrored campaign (heading and command negated) has the same parameters."""
MIXED = "mixed"
"""A mirrored campaign has the parameters of the mirrored equation: some negated, some not."""
ODD = "odd"
"""A mirrored campaign has all parameters negated."""


SINGLE, TOGETHER, SLOWLY = range(3)
"""Stages of actuators; see `Effect.stage`."""


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
    lower: float
    upper: float
    start: float
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
        """Whether fits leave it as it is."""
        return bool(self.reference or self.choices)

    def scaled(self, value: float, largest: float) -> float:
        """`value` for logs whose largest moment is `largest`."""
        power = 0.5 if self.unit.startswith("({force})^1/2") else 1.0 if "{force}" in self.unit else 0.0
        return float(value * largest**power)

    def name_in(self, dof: Dof) -> str:
        """What a motion calls it: its key in files."""
        return dof.fill(self.name)


@dataclass(frozen=True)
class Law:
    """A law of nature beside an effect's first one: its equation (a template), source, and look-alikes by name."""

    equation: str
    source: str
    mistaken_for: tuple[str, ...]


@dataclass(frozen=True)
class ParameterCard:
    """A parameter in the words, letters and units of a motion."""

    name: str
    meaning: str
    unit: str


@dataclass(frozen=True)
class Card:
    """An effect in the words, letters and units of a motion: what people read of it."""

    name: str
    equation: str
    says: str
    reveals: str
    separated_by: str
    parameters: tuple[ParameterCard, ...]
    laws: tuple[str, ...] = ()


class Effect:
    """One term; see the module's docstring for how to write one."""

    name: ClassVar[str]
    place: ClassVar[Place]
    parameters: ClassVar[tuple[Parameter, ...]]
    equation: ClassVar[str]
    says: ClassVar[str]
    reveals: ClassVar[str]
    mistaken_for: ClassVar[tuple[str, ...]]
    separated_by: ClassVar[str]
    source: ClassVar[str]
    laws: ClassVar[tuple[Law, ...]] = ()
    """Its laws beside the first, in the order of the choices."""

    parity: ClassVar[str] = EVEN
    states: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[tuple[str, ...]] = ()
    """Signals that its methods read."""

    logged: ClassVar[tuple[str, ...]] = ()
    """Columns of the log of which its signals are made, where they are no columns themselves."""

    stage: ClassVar[int] = TOGETHER
    """When an actuator acts, whatever the order in which a model lists its terms: SINGLE thrusters first, then what
    happens at once to what they give TOGETHER, at last what follows that SLOWLY."""

    steered: ClassVar[bool] = False
    placed: ClassVar[bool] = False
    """Whether the moment depends on the heading; without such an effect the simulator sums the heading at the end."""

    per_run: ClassVar[int] = 0
    """How many coefficients each run may have of its own, in units of moment; the methods get them after the values."""

    role: ClassVar[str] = ""
    """What its one parameter is in a motion's own equation, by the names of `Dof.parameters`; none for effects that are
    no part of that."""

    power: ClassVar[int | None] = None
    """With which power of the speed it resists; None for what is no drag."""

    remembers: ClassVar[bool] = False
    """Whether what a sensor shows depends on what it showed before; it then says how, in `remember`."""

    fed: ClassVar[bool] = False
    """Whether what its sensor shows depends on the moment delivered, which `read` then gets after the values."""

    delays: ClassVar[bool] = False
    """Whether it makes commands late."""

    def acts_in(self, dof: Dof) -> bool:
        """Whether it may act in a motion."""
        return True

    def shifts(self, values: Sequence[float]) -> bool:
        """Whether it makes every command late by the same time, as a logger's convention does."""
        return self.delays

    def late(self, values: Sequence[float]) -> float:
        """Seconds by which it makes late what is seen of a command; not a number where it makes nothing late."""
        return float("nan")

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
            ParameterCard(p.name_in(dof), dof.fill(p.meaning), dof.unit_in(p.unit, unit)) for p in self.parameters
        )
        return Card(
            name=self.name,
            equation=dof.fill(self.equation),
            says=dof.fill(self.says),
            reveals=dof.fill(self.reveals),
            separated_by=dof.fill(self.separated_by),
            parameters=parameters,
            laws=tuple(dof.fill(law.equation) for law in self.laws),
        )

    def names_in(self, dof: Dof) -> tuple[str, ...]:
        """What a motion calls its parameters: their keys in files."""
        return tuple(parameter.name_in(dof) for parameter in self.parameters)

    @property
    def shapes(self) -> tuple[bool, ...]:
        """Which parameters mean nothing while the effect is off: the held ones, and scanned ones beside a size."""
        sized = any(not p.scan and not p.held for p in self.parameters)
        return tuple(bool(p.held or (p.scan and sized)) for p in self.parameters)

    def held(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        """Which parameters a fit leaves as they are, at these values."""
        return tuple(p.held or not self.counts(p, values) for p in self.parameters)

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

    def lacking(self, given: Collection[str], values: Sequence[float], dof: Dof) -> str:
        """The first parameter that a file has to give and that is not among its names `given`; empty for none."""
        named = zip(self.names_in(dof), self.parameters)
        return next((n for n, p in named if n not in given and not p.choices and self.counts(p, values)), "")

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
        self, shown: Floats, before: Floats, after: Floats, length: Floats, values: tuple[Floats, ...]
    ) -> Floats:
        """What a sensor that remembers shows after a step of `length` [s] over which the truth went straight from
        `before` to `after`, when it showed `shown` at its beginning; arrays that broadcast to (P, R)."""
        return after
