"""What logs of surge, sway and yaw hold, and the structures that they may ask for: drags, couplings, a current."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from automarine_cli.dofs import PLANAR, SURGE, SWAY, YAW, Dof
from automarine_cli.effects.rudder_offset import RudderOffset
from automarine_cli.effects.rudder_race import RudderRace
from automarine_cli.errors import FitError
from automarine_cli.models.model import COMMAND_DELAY, CURRENT, INERTIA_COUPLINGS, Model, Term, label_of
from automarine_cli.runs.run import Run

CHANNELS = ("heading", "yaw_rate", "surge", "sway", "north", "east")
NORTH_EAST = ("north", "east")
PLANE_DRAG_LAWS = ("linear-drag", "quadratic-drag")
CROSS_DRAGS = ("Y_r", "N_v", "N_ur", "Y_uv")
"""Forces by the velocities of others that a hull alike on both sides has: sway force by turning, moment by drifting,
turns that are damped by the speed ahead, and the lift of a hull at an angle (Fossen 2021, chapter 6)."""
STEERED_BY = ("N_uv", "N_ur")  # a hull that its rudder alone turns has both: else drifting would turn it about
WITH_WAY_ON = (*STEERED_BY, "Y_ur", "Y_uv")
"""What such a hull may have, as it always has way on: all by lift, which grows with the speed ahead. Beside them no
inertia in yaw can be told from Munk's moment."""
OWN = tuple(dof.parameter(role) for dof in PLANAR.dofs for role in ("inertia", "linear", "quadratic"))
"""Qualified names of inertias and drags, which are above zero."""
SKEW = "planar.m_vr"
RUDDER_EFFECTS = ("rudder", "rudder-drag")
DECAY_S = 1.0  # s in which an unmeasured translation dies out, as in the Otter of Fossen's MSS (T_sway)


@dataclass(frozen=True)
class Assumption:
    """What the logs do not tell: `parameter` is taken as `equals` says, because."""

    parameter: str
    equals: str
    because: str

    def __str__(self) -> str:
        return f"{self.parameter} = {self.equals}: {self.because}"


@dataclass(frozen=True)
class Observed:
    """What the logs of a campaign hold: the `channels` that have readings, the translations that these show, and
    whether a `rudder_alone` steers, as neither a moment nor a force abeam is logged."""

    channels: tuple[str, ...]
    rudder_alone: bool = False

    @property
    def dofs(self) -> tuple[Dof, ...]:
        return tuple(dof for dof in PLANAR.dofs if dof is YAW or self.over_ground or dof.velocity in self.channels)

    @property
    def over_ground(self) -> bool:
        """Whether places are measured: velocities alone may be those through the water."""
        return set(NORTH_EAST) <= set(self.channels)

    @property
    def unread(self) -> list[tuple[Dof, Dof]]:
        """The translation that the logs do not show, with the one that stands for it."""
        return [pair for pair in ((SURGE, SWAY), (SWAY, SURGE)) if pair[0] not in self.dofs]

    @property
    def ties(self) -> tuple[tuple[str, str, float], ...]:
        """What the logs do not tell, and which parameter stands for it times which factor."""
        factors = {"inertia": 1.0, "linear": 1.0 / DECAY_S}
        return tuple(
            (dof.parameter(role), other.parameter("inertia"), factor)
            for dof, other in self.unread
            for role, factor in factors.items()
        )

    def assumptions(self, model: Model) -> tuple[Assumption, ...]:
        """What stands in for measurements that the logs lack."""
        lacking: list[Assumption] = []
        for dof, other in self.unread:
            why = f"the logs hold no {dof.name} speed and no position on the water"
            its, dies_out = other.parameter("inertia"), f"{dof.name} is taken to die out in {DECAY_S:g} s"
            lacking.append(Assumption(dof.parameter("inertia"), its, why))
            lacking.append(Assumption(dof.parameter("linear"), f"{its} / {DECAY_S:g} s", dies_out))
        if SKEW in model.fixed:
            lacking.append(Assumption(SKEW, "0", "sway and yaw are taken about the centre of both masses"))
        for name, source, factor in model.ties:
            if name == YAW.parameter("inertia"):
                why = "a rudder alone gives no moment of known size; all moments are as large as for a usual hull"
                lacking.append(Assumption(name, f"{factor:.3g} m² {source}", why))
        lacking.append(Assumption("planar.m_ur, planar.m_uv", "0", "the vehicle is taken to be alike on both sides"))
        return tuple(lacking)

    def simplest(self, sizes: Mapping[str, float]) -> Model:
        """The model with quadratic drag of everything that is measured, and what turns a hull that its rudder alone
        steers, nothing else, from `rough_sizes`."""
        values = {**sizes, **{name: factor * sizes[source] for name, source, factor in self.ties}}
        masses = tuple(values[dof.parameter("inertia")] for dof in PLANAR.dofs)
        terms = []
        for place, dof in enumerate(PLANAR.dofs):
            role = "quadratic" if dof in self.dofs else "linear"
            terms.append(Term(f"{role}-drag", (values[dof.parameter(role)],), True, place))
        if self.rudder_alone and SWAY in self.dofs:
            terms += map(Term.cross, STEERED_BY)
        couplings = tuple(f"{PLANAR.name}.{name}" for name in INERTIA_COUPLINGS)
        return Model(PLANAR, (*masses, *(0.0 for _ in couplings)), tuple(terms), "N m", fixed=couplings, ties=self.ties)

    def names(self) -> dict[str, str]:
        """Qualified names of the parameters that models of these logs may have, by what users write."""
        free = widest(self.simplest(dict.fromkeys(OWN, 1.0)), partial(candidates, observed=self)).free
        known = [SKEW] if SWAY in self.dofs else []  # by who has weighed a vehicle, also where no log can tell
        names = {name if name in CURRENT else name.partition(".")[2]: name for name in (*free, *known)}
        return names | {COMMAND_DELAY: COMMAND_DELAY}


def observed(runs: Sequence[Run]) -> Observed:
    """The channels of which any run has readings. Raises FitError where nothing but the heading is measured."""
    rudder_alone = not any(run.command_of(dof).any() for run in runs for dof in (SWAY, YAW))
    channels = Observed(tuple(name for name in CHANNELS if any(is_read(run, name) for run in runs)), rudder_alone)
    if len(channels.dofs) == 1:
        raise FitError(
            "the logs hold no surge or sway speed (surge_m_s, sway_m_s) and no position on the water (north_m and "
            "east_m): their coupling with yaw cannot be identified. Name the columns with --columns, or give "
            "the logs to "
            "automarine fit-yaw"
        )
    return channels


def with_rudder(names: Sequence[str], runs: Sequence[Run], observed: Observed) -> tuple[str, ...]:
    """Effects that are asked for, and those of a rudder where nothing else steers and every run logs it."""
    steered = observed.rudder_alone and all("rudder" in run.extras for run in runs)
    return tuple(dict.fromkeys((*names, *(RUDDER_EFFECTS if steered else ()))))


def is_read(run: Run, quantity: str) -> bool:
    """Whether a run has readings of a quantity, which are no sums of its speed."""
    column = run.channel(quantity)
    summed = run.summed_up and quantity == run.dof.position
    return column is not None and not summed and bool(np.isfinite(column).any())


@dataclass(frozen=True)
class Candidate:
    """An effect by its name, the parameters that it adds, and the model with it, which begins as the model without it,
    or so near to that that slopes are those there; where it stands for another drag, with as much at usual speed."""

    name: str
    added: tuple[str, ...]
    model: Model

    @property
    def label(self) -> str:
        return label_of(self.name, self.added)

    @property
    def dof(self) -> Dof:
        """The motion in which it acts; yaw where it does in several."""
        names = {name.partition(".")[0] for name in self.added}
        return next((dof for dof in reversed(PLANAR.dofs) if dof.name in names), YAW)

    @classmethod
    def of_term(cls, model: Model, term: Term) -> "Candidate":
        return cls.of_terms("cross-coupling" if term.is_cross else term.name, model.with_term(term), term)

    @classmethod
    def of_terms(cls, name: str, model: Model, *terms: Term) -> "Candidate":
        """The candidate of a `model` that has its `terms`, all of its name if none is given."""
        terms = terms or tuple(term for term in model.terms if term.name == name)
        added = [parameter for term in terms for parameter in model.names_of(term) if parameter in model.free]
        return cls(name, tuple(added), model)


Family = Callable[[Model], Iterator[Candidate]]


def candidates(model: Model, observed: Observed, rough: Mapping[str, float] | None = None) -> Iterator[Candidate]:
    """What logs may tell of a hull and a model lacks: couplings, laws of drag, a propeller's race past the rudder, a
    current; given `rough_sizes`, linear drag in place of quadratic drag too, which gains there at most what it gains
    beside it.

    No m_vr where a rudder alone steers: as long as motions are small any m_vr answers the rudder alike, with other
    derivatives, and it would take whatever else the model lacks."""
    have, yaw = {(term.dof, term.name) for term in model.terms}, PLANAR.index(YAW)
    for term in map(Term.cross, WITH_WAY_ON if observed.rudder_alone else CROSS_DRAGS):
        if (term.dof, term.name) not in have and (SWAY in observed.dofs or term.name == "N_ur"):
            yield Candidate.of_term(model, term)
    if SWAY in observed.dofs and SKEW in model.fixed and not observed.rudder_alone:
        fixed = tuple(name for name in model.fixed if name != SKEW)
        yield Candidate("cross-coupling", (SKEW,), replace(model, fixed=fixed))
    steering = [term.dof for term in model.terms if term.name == "rudder"]
    if unraced := [place for place in steering if (place, RudderRace.name) not in have]:
        raced = model
        for place in unraced:
            raced = raced.with_term(Term(RudderRace.name, (0.0,), dof=place))
        added = tuple(name for name in raced.parameter_names if name not in model.parameter_names)
        yield Candidate(RudderRace.name, added, raced)
    if steering and (yaw, RudderOffset.name) not in have:
        yield Candidate.of_term(model, Term(RudderOffset.name, (0.0,), dof=yaw))
    for dof in observed.dofs:
        lacking = [law for law in PLANE_DRAG_LAWS if (PLANAR.index(dof), law) not in have]
        for law in lacking:
            yield Candidate.of_term(model, Term(law, (0.0,), True, PLANAR.index(dof)))
        if rough is not None and lacking == ["linear-drag"]:
            linear = dof.parameter("linear")
            share = rough[linear] / rough[dof.parameter("quadratic")]
            terms = tuple(
                replace(term, name="linear-drag", values=(share * term.values[0],))
                if (term.dof, term.name) == (PLANAR.index(dof), "quadratic-drag") else term
                for term in model.terms
            )  # fmt: skip
            yield Candidate("linear-drag", (linear,), replace(model, terms=terms))
    if model.water is None and observed.over_ground:
        yield Candidate("current", CURRENT, replace(model, water=(0.0, 0.0)))


def widest(model: Model, family: Family) -> Model:
    """The model with everything that a family of candidates knows."""
    following = next(family(model), None)
    while following is not None:
        model = following.model
        following = next(family(model), None)
    return model


def inertia_tied(model: Model, gyration: float) -> Model:
    """The model with its inertia in yaw as its mass abeam times a square of the radius of `gyration` [m²]."""
    ahead, abeam, inertia = (dof.parameter("inertia") for dof in PLANAR.dofs)
    mass = ahead if abeam in [name for name, *_ in model.ties] else abeam
    tied = replace(model, ties=(*model.ties, (inertia, mass, gyration)))
    return tied.with_theta([*model.theta[:2], gyration * model.values[mass], *model.theta[3:]])


def structure_of(model: Model, observed: Observed) -> str:
    """Say which drags, couplings and current a model has."""
    have, parts = {(term.dof, term.name) for term in model.terms}, list[str]()
    for dof in observed.dofs:
        laws = [law.removesuffix("-drag") for law in PLANE_DRAG_LAWS if (PLANAR.index(dof), law) in have]
        parts.append(f"{dof.name} drag {' and '.join(laws)}")
    parts += [term.name for term in model.terms if term.is_cross]
    parts += dict.fromkeys(term.name for term in model.terms if not term.base)
    parts += [] if SKEW in model.fixed else [SKEW.partition(".")[2]]
    return ", ".join([*parts, *(["current"] if model.water else [])])
