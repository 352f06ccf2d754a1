"""Parameters are addressed by name, in the letters of their motion; what people named themselves is left alone."""

import numpy as np
import pytest

from automarine_cli.dofs import DOFS, HEAVE, SURGE, YAW, Dof
from automarine_cli.errors import ModelError
from automarine_cli.models.model import Model

EVERY_MOTION = pytest.mark.parametrize("dof", DOFS.values(), ids=list(DOFS))


def model_of(dof: Dof, number: str = "2") -> Model:
    """Both drags, what always acts where something does, and an effect."""
    values = [3.0, 0.5, *([-2.0] if dof.biased else []), *([4.0] if dof.restoring else [])]
    return Model.base(number, 2.0, values, dof.units.forces[0], dof)


@EVERY_MOTION
def test_parameters_have_qualified_names(dof: Dof) -> None:
    own, model = dof.symbols, model_of(dof).with_effect("sensor-lag", [0.2]).with_effect("cubic-drag", [0.1])
    base = [own.inertia, own.quadratic, own.linear, *([own.constant] if dof.biased else [])]
    base += [own.restoring] if dof.restoring else []
    qualified = [f"{dof.name}.{name}" for name in base]
    assert model.parameter_names == (*qualified, "sensor-lag.T_s", f"cubic-drag.{own.cubic}")
    assert model.short_names == (*base, "T_s", own.cubic)
    assert [model.theta[model.index(name)] for name in model.parameter_names] == list(model.theta)
    assert model.theta[model.index(dof.parameter("quadratic"))] == 3.0
    with pytest.raises(ModelError, match=rf"no parameter 'k'; it has {dof.name}\.{own.inertia}, "):
        model.index("k")


def test_names_that_two_effects_have_are_told_apart() -> None:
    model = Model.base("3", 1.0, [1.2], "nu", YAW).with_effect("linear-drag", [0.1])
    model = model.with_effect("bias-moment", [0.05]).with_effect("thrust-loss", [0.05])
    assert model.parameter_names[2:] == ("linear-drag.k_r", "bias-moment.b", "thrust-loss.b", "thrust-loss.law")
    assert model.short_names == ("I_r", "k_rr", "k_r", "b", "thrust-loss.b", "law")
    sided = Model.base("3", 1.0, [1.2, 0.3], "N", SURGE).with_effect("bias-moment", [0.05])
    assert sided.parameter_names == ("surge.m_u", "surge.X_uu", "surge.half_difference", "bias-moment.b")


def test_drag_of_a_model_is_what_its_effects_say_it_is() -> None:
    both = Model.base("3", 1.0, [1.2], "nu", YAW).with_effect("linear-drag", [0.1])
    assert both.drag() == (0.1, 1.2)
    heave = Model.base("3", 20.0, [45.0, -2.0, 6.0], "N", HEAVE)
    forces = np.array([-8.0, 8.0])
    moment, linear, quadratic = heave.acting(forces)
    assert np.array_equal(moment, forces - 2.0) and np.array_equal(quadratic, [39.0, 51.0])
    assert np.array_equal(linear, [0.0, 0.0])
    surge = Model.base("1", 20.0, [5.0, 1.0], "N", SURGE)
    assert np.array_equal(surge.acting(forces)[1], [4.0, 6.0])
