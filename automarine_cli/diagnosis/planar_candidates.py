"""What may be added to a planar model: couplings, a current, what stands between command and moment."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from automarine_cli import effects
from automarine_cli.dofs import SWAY, YAW
from automarine_cli.fits.planar_structure import COUPLINGS, LAWS, Observed, Structure
from automarine_cli.models.planar import derivative, parameters_of
from automarine_cli.models.planar_store import StoredPlanar
from automarine_cli.models.tied import Tied
from automarine_cli.models.yaw_model import Term

SMALL = 0.02
"""Share of its usual size at which an actuator effect is as good as none."""
OF_YAW = ("input-delay", "thruster-lag", "dead-band")
SAYS = {
    "cross-coupling": "One motion drives another",
    "munk-moment": "Sway takes more water along than surge, which turns a drifting hull",
    "current": "The water moves",
}
SPLIT_BY = {
    "Y_r": "turns on the spot under a moment alone",
    "N_v": "thrust abeam from rest, without way on",
    "N_ur": "turns under one moment at several speeds ahead",
    "Y_uv": "thrust abeam at several speeds ahead",
    "m_vr": "short pulses of thrust abeam from rest",
    "m_v": "oblique courses at several speeds: its moment grows with surge times sway",
    "north": "drifting without thrust",
}
"""Runs that tell one coupling from others, by the first letter that it adds."""


@dataclass(frozen=True)
class Candidate:
    """An effect by its name, the parameters that it adds, and the model with it, which begins as the model without it,
    or so near to that that slopes are those there."""

    name: str
    added: tuple[str, ...]
    model: Tied

    @property
    def label(self) -> str:
        """The name with the letters of what is added: cross-coupling N_v."""
        return f"{self.name} {', '.join(name.rpartition('.')[2] for name in self.added)}"

    @property
    def says(self) -> str:
        """What it is, and by which parameters."""
        what = SAYS.get(self.name) or effects.get(self.name).card(YAW).says.rstrip(".")
        return f"{what} ({', '.join(self.added)})."

    @property
    def split_by(self) -> str:
        """The run that would tell it from what is named."""
        run = SPLIT_BY.get(self.added[0].rpartition(".")[2]) or effects.get(self.name).card(YAW).separated_by
        return f"{run[:1].upper()}{run[1:]}."


def base_of(stored: StoredPlanar, seen: Observed) -> Tied:
    """The stored model with the parameters free that its fit had free, and what the logs do not tell tied.

    Without a fit those are free that are not zero. A mass abeam that equals the mass ahead is tied to it.
    """
    model = stored.model
    known = set(model.parameter_names)
    ties = {name: tie for name, tie in Structure.simplest(seen).ties.items() if {name, tie[0]} <= known}
    if SWAY.parameter("inertia") not in ties and model.inertia.m_v == model.inertia.m_u:
        ties[SWAY.parameter("inertia")] = ("surge.m_u", 1.0)
    wanted = stored.free or tuple(name for name, value in zip(model.parameter_names, model.theta) if value)
    return Tied(model, tuple(name for name in model.parameter_names if name in wanted and name not in ties), ties)


def candidates(base: Tied, seen: Observed, largest: float) -> Iterator[Candidate]:
    """What may be added to a model; `largest` is the largest moment [N m]."""
    model, have = base.model, {term.name for term in base.model.cross}
    for name in COUPLINGS:
        if name in have or not (SWAY in seen.dofs or name == "N_ur"):
            continue
        added = f"{base.motion.dofs[derivative(name)[0]].name}.{name}"
        wider = replace(model, cross=(*model.cross, Term(name, (0.0,))))
        yield Candidate("cross-coupling", (added,), Tied(wider, (*base.free, added), base.ties))
    if SWAY in seen.dofs and "planar.m_vr" not in base.free:
        yield Candidate("cross-coupling", ("planar.m_vr",), Tied(model, (*base.free, "planar.m_vr"), base.ties))
    for dof in seen.dofs:
        own: tuple[Term, ...] = getattr(model, dof.name)
        for law in [law for law in LAWS[-1] if law not in [term.name for term in own]]:
            added_drag = dof.parameter(law.removesuffix("-drag"))
            more: dict[str, Any] = {dof.name: (*own, Term(law, (0.0,)))}
            wider = replace(model, **more)
            yield Candidate(law, (added_drag,), Tied(wider, (*base.free, added_drag), base.ties))
    mass = SWAY.parameter("inertia")
    if mass in base.ties:
        ties = {name: tie for name, tie in base.ties.items() if name != mass}
        yield Candidate("munk-moment", (mass,), Tied(model, (*base.free, mass), ties))
    if model.water is None and seen.over_ground:
        added_both = ("current.north", "current.east")
        wider = replace(model, water=(0.0, 0.0))
        yield Candidate("current", added_both, Tied(wider, (*base.free, *added_both), base.ties))
    for name in OF_YAW:
        if name in {term.name for term in model.yaw}:
            continue
        effect = effects.get(name)
        values = tuple(p.off + (not p.held) * SMALL * p.scaled(p.start, largest) for p in effect.parameters)
        term = Term(name, values)
        names = [n for n, held in zip(parameters_of(YAW, term), effect.held(values)) if not held]
        wider = replace(model, yaw=(*model.yaw, term))
        yield Candidate(name, tuple(names), Tied(wider, (*base.free, *names), base.ties))
