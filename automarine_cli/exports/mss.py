"""Fossen's Marine Systems Simulator and its Python twin: constants with the names and signs of SNAME derivatives.

(I_z - N_rdot) r' = tau_N + N_r r + N_rr |r| r + N_rrr r^3 + N_r2 r^2 + N_absr |r| + N_0: derivatives of the
hydrodynamic moment, so damping and added inertia are negative. Sources: Fossen (2021), Handbook of Marine Craft
Hydrodynamics and Motion Control, sections 6.3 and 6.4; MSS, CRAFT/USV/models/otter.m (Nr, Nrdot); Norrbin (1971) for
N_rrr.

Several motions are a MATLAB function with M, C and D, as the toolbox's vessels have them (section 6.5 of the Handbook):
M nu_r' + C(nu_r) nu_r + D(nu_r) nu_r + g = tau + tau_delta, the last by a rudder's angle.
"""

from automarine_cli import effects
from automarine_cli.exports import base
from automarine_cli.exports.vehicle import MATRIX_EFFECTS, PLANES, STEERING, Vehicle
from automarine_cli.models.model import CONSTANT, RESTORING

AXES = "xyzxyz"  # along or about which the six motions are


def write(subject: Vehicle) -> base.Written:
    return _function(subject) if subject.several else _constants(subject.axis)


def _constants(subject: base.MotionSubject) -> base.Written:
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
        if effect in base.DRAGS or effect in subject.values:
            value = subject.value(effect) if effect == "bias-moment" else -subject.value(effect)
            unit = subject.dof.unit_in(effects.get(effect).parameters[0].unit, subject.model.moment_unit)
            rows.append((name, value, base.plain(unit), meaning))
            equation += f" + {name} {factor}".rstrip()
    if steering := subject.values.get("rudder"):
        equation += f" + {subject.equation_of('rudder')}"
        rudder = effects.get("rudder")
        cards = rudder.card(subject.dof, subject.model.moment_unit).parameters
        rows += [
            (card.name, value, base.plain(card.unit), base.plain(card.meaning))
            for card, value, held in zip(cards, steering, rudder.held(steering)) if not held
        ]  # fmt: skip
    signs = f"Signs: derivatives of the hydrodynamic {words.force}; damping and added {words.inertia} are negative."
    notes = (signs, subject.about_inertia())
    sign, end = ("%", ";") if subject.form == "matlab" else ("#", "")
    lines = "".join(f"{name} = {base.number(x)}{end}  {sign} {unit}, {meaning}\n" for name, x, unit, meaning in rows)
    return base.Written(base.comment(base.head(subject, equation, notes), sign) + lines, notes)


def _function(subject: Vehicle) -> base.Written:
    """M, C and D of the plane as three by three, of all else as six by six."""
    in_plane = subject.places == PLANES and len(subject.origins) == 1
    places = PLANES if in_plane else list(range(6))
    lines = []
    for drag in subject.drags:
        entry = f"D({places.index(drag.places[0]) + 1},{places.index(drag.places[-1]) + 1})"
        size = f" * {drag.factor}" if drag.factor else ""
        meaning = "positive where it resists" if drag.rank < 2 else drag.meaning
        lines.append(f"{entry} = {entry} + {base.number(drag.value)}{size};  % {drag.name}, {meaning}\n")
    flow, fields = "", dict.fromkeys(("argument", "says", "unset", "add"), "")
    for i, name, value, factor, meaning in subject.steering("delta", "tau(1)"):
        entry, factor = f"tau_flow({places.index(i) + 1})", factor.replace("**", "^")
        flow += f"{entry} = {entry} + {base.number(value)} * {factor};  % {name}, {meaning}\n"
    if flow:
        flow, fields["add"] = f"tau_flow = zeros({len(places)}, 1);\n{flow}", " + tau_flow"
    if "delta" in flow:
        unset = f"if nargin < {4 if in_plane else 5}\n    delta = 0;\nend\n"
        says = "\n% tau_flow holds the force of a rudder at the angle delta [rad], signed as in the logs (default: 0)."
        fields |= {"argument": ", delta", "unset": unset, "says": says}
    text = fields | {
        "flow": flow, "inertia": "; ".join(base.row(line) for line in subject.inertia[places][:, places]),
        "drag": "".join(lines), "constant": base.row(subject.diagonal(CONSTANT)[places]),
        "restoring": base.row(subject.diagonal(RESTORING)[3:5]), "axes": " ".join(str(i + 1) for i in subject.places),
        "head": base.comment(subject.head(), "%"),
    }  # fmt: skip
    return base.Written(base.filled("mss_planar" if in_plane else "mss_vehicle", text), subject.about_water())


TARGET = base.Target(
    name="mss",
    says="Fossen's MSS and its Python twin: constants N_r, N_rr with their signs",
    forms={"python": ".py", "matlab": ".m"}, frames=("NED",), carries=MATRIX_EFFECTS | {"rudder"}, si=False,
    write=write, several=base.Several({"matlab": ".m"}, MATRIX_EFFECTS | STEERING, couples=True),
)  # fmt: skip
