"""Drag that drives is refused, either way round, and every drag that brakes is let through."""

import pytest

from automarine_cli.diagnosis.scores import drag_drives
from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import YawModel


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_asymmetry_drives_where_it_outgrows_the_drag(sign: float) -> None:
    """k_r r + e r² changes its sign at |r| = k_r/|e|."""
    model = YawModel.base("1", 20.0, [10.0], "nu", YAW).with_effect("drag-asymmetry", [sign * 20.0])
    assert drag_drives(model, 0.6) and not drag_drives(model, 0.4)


@pytest.mark.parametrize("e", [-0.9, 0.0, 0.9])
def test_an_asymmetry_within_the_quadratic_drag_brakes_at_all_rates(e: float) -> None:
    model = YawModel.base("3", 1.0, [1.0], "nu", YAW).with_effect("drag-asymmetry", [e])
    assert not drag_drives(model, 1e-3) and not drag_drives(model, 100.0)


def test_what_is_no_drag_is_not_asked() -> None:
    model = (
        YawModel.base("1", 20.0, [0.0], "nu", YAW)
        .with_effect("cross-coupling", [30.0])
        .with_effect("bias-moment", [1.0])
    )
    assert not drag_drives(model, 1.0)
