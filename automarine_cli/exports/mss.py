"""Fossen's Marine Systems Simulator and its Python twin: constants with the names and signs of SNAME derivatives.

(I_z - N_rdot) r' = tau_N + N_r r + N_rr |r| r + N_rrr r^3 + N_r2 r^2 + N_0: derivatives of the hydrodynamic moment, so
damping and added inertia are negative. Sources: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion
Control, sections 6.3 and 6.4; MSS, CRAFT/USV/models/otter.m (Nr, Nrdot); Norrbin (1971) for N_rrr.
"""

from automarine_cli.exports.base import DRAG, Target, Written, YawSubject, commented, head, number

EQUATION = "(I_z - N_rdot) r' = tau_N + N_r r + N_rr |r| r"
MORE = {
    "cubic-drag": ("N_rrr", " + N_rrr r^3"),
    "drag-asymmetry": ("N_r2", " + N_r2 r^2"),
}
SIGNS = "Signs: hydrodynamic derivatives; damping N_r, N_rr and added inertia N_rdot are negative."


def write(subject: YawSubject) -> Written:
    """The Python or MATLAB text."""
    unit = subject.model.moment_unit
    rigid, added = subject.inertias
    values = {
        "I_z": (rigid, f"{unit} s^2, rigid inertia"),
        "N_rdot": (-added, f"{unit} s^2, added inertia"),
        "N_r": (-subject.value("linear-drag"), f"{unit} s, linear damping"),
        "N_rr": (-subject.value("quadratic-drag"), f"{unit} s^2, damping with |r| r"),
    }
    equation = EQUATION
    for effect, (name, term) in MORE.items():
        if effect in subject.values:
            values[name] = (-subject.value(effect), f"{unit} s^{3 if name == 'N_rrr' else 2}, {effect}")
            equation += term
    if "bias-moment" in subject.values:
        values["N_0"] = (subject.value("bias-moment"), f"{unit}, constant moment")
        equation += " + N_0"
    notes = (SIGNS, subject.about_inertia())
    sign, end = ("%", ";") if subject.form == "matlab" else ("#", "")
    lines = "".join(
        f"{name} = {number(value)}{end}  {sign} {told}\n" for name, (value, told) in values.items()
    )
    return Written(commented(head(subject, equation, notes), sign) + lines, notes)


TARGET = Target(
    name="mss",
    says="Fossen's MSS and its Python twin: constants N_r, N_rr with their signs",
    source="github.com/cybergalactic/MSS",
    forms={"python": ".py", "matlab": ".m"},
    frames=("NED",),
    carries=frozenset({*DRAG, *MORE, "bias-moment"}),
    si=False,
    uses=frozenset({"rigid_inertia", "newton_metres_per_nu"}),
    write=write,
)
