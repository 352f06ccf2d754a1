"""What a planar model may be made of, given what the logs hold; the rest is tied to assumptions that have a name.

A structure says which drags, couplings and current a model has. `neighbours` are those with one more term, or with
another law of drag, so that a search by evidence can walk from the simplest one to the one that the logs ask for.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.dofs import SURGE, SWAY, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import FitError
from automarine_cli.models.yaw_model import COMMAND_DELAY, INERTIA_COUPLINGS, Term, YawModel
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

CHANNELS = ("heading", "yaw_rate", "surge", "sway", "north", "east")
PLACES = ("north", "east")
LAWS = (("quadratic-drag",), ("linear-drag",), ("linear-drag", "quadratic-drag"))
COUPLINGS = ("Y_r", "N_v", "N_ur", "Y_uv")
"""Forces by the velocities of others that a hull alike on both sides has: sway force by turning, moment by drifting,
turns that are damped by the speed ahead, and the lift of a hull at an angle (Fossen 2021, chapter 6)."""
OWN = tuple(dof.parameter(role) for dof in PLANAR.dofs for role in ("inertia", "linear", "quadratic"))
"""Qualified names of inertias and drags, which are above zero."""
SETTLES = 1.0  # s in which an unmeasured translation dies out, as in the Otter of Fossen's MSS (T_sway)
WINDOW = 1.0  # s over which velocities are told from positions


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
    """What the logs of a campaign hold: the `channels` that have readings, the translations that these show."""

    channels: tuple[str, ...]

    @property
    def dofs(self) -> tuple[Dof, ...]:
        return tuple(dof for dof in PLANAR.dofs if dof is YAW or self.over_ground or dof.velocity in self.channels)

    @property
    def over_ground(self) -> bool:
        """Whether places are measured: velocities alone may be those through the water."""
        return set(PLACES) <= set(self.channels)


def observed(runs: Sequence[Run]) -> Observed:
    """The channels of which any run has readings. Raises FitError where nothing but the heading is measured."""
    channels = Observed(tuple(name for name in CHANNELS if any(_read(run, name) for run in runs)))
    if len(channels.dofs) == 1:
        raise FitError(
            "the logs hold no surge or sway speed (surge_m_s, sway_m_s) and no position on the water (north_m and "
            "east_m): their coupling with yaw cannot be identified. Name the columns with --columns, or give "
            "the logs to "
            "automarine fit-yaw"
        )
    return channels


def _read(run: Run, quantity: str) -> bool:
    column = run.channel(quantity)
    summed = run.summed_up and quantity == run.dof.position
    return column is not None and not summed and bool(np.isfinite(column).any())


@dataclass(frozen=True)
class Structure:
    """Laws of drag by degree of freedom, couplings, whether sway and yaw share inertia (m_vr), and a current.

    `observed` says what of it the logs can tell.
    """

    observed: Observed
    laws: Mapping[str, tuple[str, ...]]
    couplings: tuple[str, ...] = ()
    skewed: bool = False
    current: bool = False

    @classmethod
    def simplest(cls, observed: Observed) -> "Structure":
        """Quadratic drag of everything that is measured, nothing else."""
        return cls(observed, {dof.name: LAWS[0] for dof in observed.dofs})

    @property
    def widest(self) -> "Structure":
        """Everything that the logs can tell of."""
        couplings = tuple(name for name in COUPLINGS if SWAY in self.observed.dofs or name == "N_ur")
        sideways = SWAY in self.observed.dofs
        laws = dict.fromkeys(self.laws, LAWS[-1])
        return replace(self, laws=laws, couplings=couplings, skewed=sideways, current=self.observed.over_ground)

    @property
    def names(self) -> dict[str, str]:
        """Qualified names of the parameters that structures of these logs may have, by what users write."""
        free = self.widest.model(dict.fromkeys(OWN, 1.0)).free
        names = {name if name.startswith("current") else name.partition(".")[2]: name for name in free}
        return names | {COMMAND_DELAY: COMMAND_DELAY}

    def neighbours(self) -> Iterator["Structure"]:
        """Structures one step away: another law of one drag, one more coupling, a shared inertia, a current."""
        for name, law in self.laws.items():
            replacements = (other for other in LAWS if other != law and len(other) >= len(law))
            yield from (replace(self, laws={**self.laws, name: other}) for other in replacements)
        widest = self.widest
        yield from (
            replace(self, couplings=(*self.couplings, name)) for name in widest.couplings if name not in self.couplings
        )
        if widest.skewed and not self.skewed:
            yield replace(self, skewed=True)
        if widest.current and not self.current:
            yield replace(self, current=True)

    def __str__(self) -> str:
        drags = (
            f"{name} drag {' and '.join(term.removesuffix('-drag') for term in law)}" for name, law in self.laws.items()
        )
        more = [*self.couplings, *["m_vr"] * self.skewed, *["current"] * self.current]
        return ", ".join([*drags, *more])

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """What stands in for measurements that the logs lack."""
        lacking: list[Assumption] = []
        for dof, other in self._unread:
            why = f"the logs hold no {dof.name} speed and no position on the water"
            its, dies_out = other.parameter("inertia"), f"{dof.name} is taken to die out in {SETTLES:g} s"
            lacking.append(Assumption(dof.parameter("inertia"), its, why))
            lacking.append(Assumption(dof.parameter("linear"), f"{its} / {SETTLES:g} s", dies_out))
        if not self.skewed:
            lacking.append(Assumption("planar.m_vr", "0", "sway and yaw are taken about the centre of both masses"))
        lacking.append(Assumption("planar.m_ur, planar.m_uv", "0", "the vehicle is taken to be alike on both sides"))
        return tuple(lacking)

    def model(self, sizes: Mapping[str, float]) -> YawModel:
        """The model with start values `sizes` by qualified name: those of `rough_sizes`, and what is known better."""
        terms, ties = [], self.ties
        values = {**sizes, **{name: factor * sizes[source] for name, source, factor in ties}}
        for place, dof in enumerate(PLANAR.dofs):
            for law in self.laws.get(dof.name, ("linear-drag",)):  # of what is tied
                value = values[dof.parameter(law.removesuffix("-drag"))]
                terms.append(Term(law, (value,), True, place))
        for name in self.couplings:
            term = Term.cross(name)
            size = values.get(f"{PLANAR.dofs[term.dof].name}.{name}", 0.0)
            terms.append(replace(term, values=(size,)))
        water = (values.get("current.north", 0.0), values.get("current.east", 0.0)) if self.current else None
        couplings = [values.get(f"{PLANAR.name}.{name}", 0.0) if name == "m_vr" else 0.0 for name in INERTIA_COUPLINGS]
        masses = (*(values[dof.parameter("inertia")] for dof in PLANAR.dofs), *couplings)
        fixed = (*(() if self.skewed else ("planar.m_vr",)), "planar.m_ur", "planar.m_uv")
        return YawModel(PLANAR, masses, tuple(terms), "N m", water, fixed, ties)

    def beside(self, values: Mapping[str, float], rough: Mapping[str, float]) -> YawModel:
        """The model with `values` of another structure by qualified name: what that lacks is zero, or takes over
        at the usual velocity where one law of drag stands for another."""
        sizes = {**rough, **values}
        for dof in self.observed.dofs:
            laws = {role: dof.parameter(role) for role in ("linear", "quadratic")}
            lacking = [role for role, name in laws.items() if name not in values]
            for role in lacking:
                (other,) = set(laws) - {role}
                share = rough[laws[role]] / rough[laws[other]]
                taken_over = f"{other}-drag" not in self.laws[dof.name]
                sizes[laws[role]] = share * values[laws[other]] if taken_over else 0.0
        return self.model(sizes)

    @property
    def _unread(self) -> list[tuple[Dof, Dof]]:
        """The translation that the logs do not show, with the one that stands for it."""
        return [pair for pair in ((SURGE, SWAY), (SWAY, SURGE)) if pair[0] not in self.observed.dofs]

    @property
    def ties(self) -> tuple[tuple[str, str, float], ...]:
        """What the logs do not tell, and which parameter stands for it times which factor."""
        factors = {"inertia": 1.0, "linear": 1.0 / SETTLES}
        return tuple(
            (dof.parameter(role), other.parameter("inertia"), factor)
            for dof, other in self._unread
            for role, factor in factors.items()
        )


def rough_velocities(run: Run) -> dict[str, Floats]:
    """Surge, sway [m/s] and yaw rate [rad/s] of a run, each (N,): as read, else from places and heading over
    `WINDOW`; NaN where neither tells."""
    velocities: dict[str, Floats] = {}
    if _read(run, YAW.position):
        velocities[YAW.velocity] = _slope(run.time, run.position)
    if all(_read(run, name) for name in PLACES):
        north, east = (_slope(run.time, np.asarray(run.channel(name))) for name in PLACES)
        cosine, sine = np.cos(run.position), np.sin(run.position)
        velocities[SURGE.velocity] = cosine * north + sine * east
        velocities[SWAY.velocity] = cosine * east - sine * north
    for dof in PLANAR.dofs:
        if _read(run, dof.velocity):
            velocities[dof.velocity] = np.asarray(run.channel(dof.velocity))
    return velocities


def _slope(time: Floats, values: Floats) -> Floats:
    """Central difference over `WINDOW`, (N,)."""
    finite = np.isfinite(values)
    ahead, behind = (np.clip(time + side * WINDOW / 2, time[0], time[-1]) for side in (1, -1))
    there, back = (np.interp(at, time[finite], values[finite]) for at in (ahead, behind))
    return np.asarray((there - back) / np.maximum(ahead - behind, 1e-9))


def rough_sizes(runs: Sequence[Run]) -> dict[str, float]:
    """Orders of size from which fits start, by qualified name: drag that balances the usual force at the usual
    velocity, and an inertia that takes `SETTLES` to get there."""
    sizes: dict[str, float] = {}
    for dof in PLANAR.dofs:
        forces = np.concatenate([run.command_of(dof) for run in runs])
        columns = [v[dof.velocity] for run in runs if dof.velocity in (v := rough_velocities(run))]
        speeds = np.abs(np.concatenate(columns)) if columns else np.zeros(0)
        speeds = speeds[np.isfinite(speeds)]
        speed = max(float(np.quantile(speeds, 0.9)) if len(speeds) else 0.0, dof.limits.unmoved)
        force = float(np.sqrt(np.mean(forces**2)))
        linear = max(force, 1e-3) / speed
        sizes |= {
            dof.parameter("linear"): linear,
            dof.parameter("quadratic"): linear / speed,
            dof.parameter("inertia"): linear * SETTLES,
        }
    for dof, other in ((SURGE, SWAY), (SWAY, SURGE)):
        if not any(run.command_of(dof).any() for run in runs):  # moved by the others alone
            for role in ("linear", "quadratic", "inertia"):
                sizes[dof.parameter(role)] = sizes[other.parameter(role)]
    return sizes
