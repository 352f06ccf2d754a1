"""A formula as a file of the library of effects: what `automarine effects --new` takes."""

import re

from automarine_cli.diagnosis.formula import Formula, formula_of
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.dofs import Dof
from automarine_cli.effects.learned import DRAG, GAIN, MOMENT

FILE = '''"""{title}: {text}, proposed from a learned curve."""

import numpy as np

from automarine_cli.effects.base import (MIXED, Effect, Parameter, Place, State)
from automarine_cli.quantities import Floats


class {name_of_class}(Effect):
    """{text}, x = {variable}."""

    name = {name!r}
    place = Place.MOMENT
    parameters = (
{parameters}
    )
    equation = {equation!r}
    says = {says!r}
    reveals = {reveals!r}
    mistaken_for = ()
    separated_by = {separated!r}
    source = "a curve that automarine diagnose learned; look for the physics of it"
    parity = MIXED
    needs = {needs!r}
    steered = {steered}

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        {names} = values
        x = {read}
        return {code}
'''


WORDS = {MOMENT: "{force}", GAIN: "thrust", DRAG: "drag"}
"""What a curve of each kind changes."""


def file_name(curve: LearnedCurve, formula: Formula) -> str:
    """The name under which the effect's file has to be kept."""
    return f"{_name(curve, formula).replace('-', '_')}.py"


def effect_file(curve: LearnedCurve, formula: Formula) -> str:
    """The text of a file that holds the formula as an effect."""
    form = formula.form
    code = form.code + (" + c" if formula.constant else "")
    read = f"np.abs({curve.read})" if curve.sized else curve.read
    if curve.kind == MOMENT:
        code = f"np.sign({curve.read}) * ({code})" if curve.sized else code
    else:
        code = f"{'state.delivered' if curve.kind == GAIN else '-state.relative'} * ({code})"
    unit = {MOMENT: "{force}", GAIN: "1", DRAG: "{force} s{/x}"}[curve.kind]
    variable = curve.variable.replace("{", "{{").replace("}", "}}")
    rows = []
    for name, estimate in formula.parameters.items():
        value = float(f"{estimate.value:.4g}")
        if name in form.shape:
            rows.append(f'Parameter("{name}", "shape", "", -np.inf, np.inf, {value!r}, scan=({value!r},)),')
        else:
            rows.append(f'Parameter("{name}", "coefficient", "{unit}", -np.inf, np.inf, {value!r}),')
    name = _name(curve, formula)
    return FILE.format(
        title={MOMENT: "A moment", GAIN: "Thrust times", DRAG: "Linear drag"}[curve.kind],
        text=formula.text,
        name_of_class="".join(part.capitalize() for part in name.split("-")),
        variable=re.sub(r"[^\w .()/-]", " ", curve.variable),
        name=name,
        parameters="\n".join(f"        {row}" for row in rows),
        equation=equation_of(curve, formula),
        says=f"The {WORDS[curve.kind]} depends on {variable}.",
        reveals=f"the same {{forces}} over the whole range of {variable}",
        separated=f"runs in which {variable} changes and all else stays as it is",
        needs=curve.needs,
        steered="state.position" in curve.read or "state.travelled" in curve.read,
        names=", ".join(formula.parameters) + ("," if len(formula.parameters) == 1 else ""),
        read=read,
        code=code,
    )


def equation_of(curve: LearnedCurve, formula: Formula) -> str:
    """What the formula adds to the sum of moments or forces, a template that a motion fills."""
    plain = formula.text
    of = {MOMENT: f"sgn(x) ({plain})" if curve.sized else plain, GAIN: f"{{f}}_delivered ({plain})",
          DRAG: f"-{{v}} ({plain})"}[curve.kind]  # fmt: skip
    variable = curve.variable.replace("{", "{{").replace("}", "}}")
    return f"{of}, x = {'size of ' if curve.sized else ''}{variable}"


def _name(curve: LearnedCurve, formula: Formula) -> str:
    """The effect's name: its variable, and its form."""
    variable = re.sub(r"[^a-z0-9]+", "-", curve.variable.lower()).strip("-") or "x"
    return f"own-{variable}-{formula.form.name}"


def learned_json(curve: LearnedCurve, runs: int, dof: Dof) -> dict[str, object]:
    """The contract's form of a curve learned from so many runs of a motion, with its formula, null where no form
    fits."""
    formula = formula_of(curve, runs)
    told = None
    if formula is not None:
        file = {"file": file_name(curve, formula), "effect": effect_file(curve, formula)}
        told = formula.to_json() | {"equation": dof.fill(equation_of(curve, formula))} | file
    return {**curve.to_json(), "formula": told}
