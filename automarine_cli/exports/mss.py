"""Fossen's Marine Systems Simulator and its Python twin: constants with the names and signs of SNAME derivatives.

(I_z - N_rdot) r' = tau_N + N_r r + N_rr |r| r + N_rrr r^3 + N_r2 r^2 + N_absr |r| + N_0: derivatives of the
hydrodynamic moment, so damping and added inertia are negative. Sources: Fossen (2021), Handbook of Marine Craft
Hydrodynamics and Motion Control, sections 6.3 and 6.4; MSS, CRAFT/USV/models/otter.m (Nr, Nrdot); Norrbin (1971) for
N_rrr.

In the plane a MATLAB function with M, C and D, as vessels of the toolbox have them (section 6.5 of the Handbook):
M nu_r' + C(nu_r) nu_r + D(nu_r) nu_r = tau.
"""

from automarine_cli import effects
from automarine_cli.exports.base import DRAGS, Planar, Target, Written, YawSubject, comment, filled, head, number, plain
from automarine_cli.exports.planar import PlanarSubject
from automarine_cli.models.model import VELOCITIES

MSS_EFFECTS = ("cubic-drag", "drag-asymmetry", "linear-drag-asymmetry", "bias-moment", "restoring-moment")
AXES = "xyzxyz"  # along or about which the six motions are


def write(subject: YawSubject) -> Written:
    force, r, words = subject.force, subject.dof.symbols.velocity, subject.dof.words
    rigid, added = subject.inertias
    rigid_symbol = f"I_{AXES[subject.dof.number]}" if subject.dof.angular else "m"
    angle = subject.dof.symbols.position
    terms = {
        "linear-drag": (f"{force}_{r}", r, "linear damping"),
        "quadratic-drag": (f"{force}_{r}{r}", f"|{r}| {r}", "quadratic damping"),
        "cubic-drag": (f"{force}_{r}{r}{r}", f"{r}^3", "cubic damping"),
        "drag-asymmetry": (f"{force}_{r}2", f"{r}^2", "asymmetric damping"),
        "linear-drag-asymmetry": (f"{force}_abs{r}", f"|{r}|", "asymmetric damping"),
        "bias-moment": (f"{force}_0", "", "constant"),
        "restoring-moment": (f"{force}_{angle}", f"sin({angle})", "restoring"),
    }
    rows = [(rigid_symbol, rigid, subject.unit, "rigid"), (f"{force}_{r}dot", -added, subject.unit, "added")]
    letter = subject.dof.symbols.force
    applied = force if letter == force else f"{letter}_{force}"
    equation = f"({rigid_symbol} - {force}_{r}dot) {r}' = {applied}"
    for effect, (name, factor, meaning) in terms.items():
        if effect in DRAGS or effect in subject.values:
            value = subject.value(effect) if effect == "bias-moment" else -subject.value(effect)
            unit = subject.dof.unit_in(effects.get(effect).parameters[0].unit, subject.model.moment_unit)
            rows.append((name, value, plain(unit), meaning))
            equation += f" + {name} {factor}".rstrip()
    signs = f"Signs: derivatives of the hydrodynamic {words.force}; damping and added {words.inertia} are negative."
    notes = (signs, subject.about_inertia())
    sign, end = ("%", ";") if subject.form == "matlab" else ("#", "")
    lines = "".join(f"{name} = {number(value)}{end}  {sign} {unit}, {meaning}\n" for name, value, unit, meaning in rows)
    return Written(comment(head(subject, equation, notes), sign) + lines, notes)


def write_planar(subject: PlanarSubject) -> Written:
    lines = []
    for name, places, value in subject.drags():
        i, j = places[0], places[-1]
        size = f" * abs({VELOCITIES[places[1]]})" if len(places) == 3 else ""
        entry = f"D({i + 1},{j + 1})"
        lines.append(f"{entry} = {entry} + {number(value)}{size};  % {name}, positive where it resists\n")
    rows = "; ".join(" ".join(number(value) for value in line) for line in subject.inertia)
    text = {
        "head": comment(subject.head(), "%"),
        "inertia": rows,
        "drag": "".join(lines),
        "constant": " ".join(number(value) for value in subject.constant),
    }
    return Written(filled("mss_planar", text), subject.about_water())


TARGET = Target(
    name="mss",
    says="Fossen's MSS and its Python twin: constants N_r, N_rr with their signs",
    forms={"python": ".py", "matlab": ".m"},
    frames=("NED",),
    carries=frozenset({*DRAGS, *MSS_EFFECTS}),
    si=False,
    uses=frozenset({"rigid_inertia", "newton_metres_per_nu"}),
    write=write,
    planar=Planar({"matlab": ".m"}, ("NED",), write_planar),
)
