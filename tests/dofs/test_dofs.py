"""The records of the degrees of freedom: complete, distinct, and the one place from which texts are filled."""

import pickle
from dataclasses import fields

import pytest

from automarine_cli.dofs import DOFS, HEAVE, SURGE, SWAY, YAW, Dof


@pytest.mark.parametrize("dof", DOFS.values(), ids=DOFS)
def test_every_word_and_symbol_is_there_and_a_record_is_one_object_in_every_process(dof: Dof) -> None:
    assert pickle.loads(pickle.dumps(dof)) is dof
    for record in (dof.symbols, dof.words, dof.units):
        for field in fields(record):
            assert getattr(record, field.name), (dof.name, field.name)
    for field in fields(dof.limits):
        value = getattr(dof.limits, field.name)
        assert all(limit > 0 for limit in (value if isinstance(value, tuple) else (value,))), field.name


def test_no_two_motions_share_a_symbol_of_a_parameter() -> None:
    every = [name for dof in DOFS.values() for name in (dof.symbols.inertia, dof.symbols.linear, dof.symbols.quadratic)]
    assert len(set(every)) == len(every) == 3 * len(DOFS)


@pytest.mark.parametrize(
    ("role", "yaw", "surge", "newtons"),
    [
        ("inertia", "nu s²", "nu s²/m", "kg"),
        ("linear", "nu s", "nu s/m", "N s/m"),
        ("quadratic", "nu s²", "nu s²/m²", "N s²/m²"),
        ("cubic", "nu s³", "nu s³/m³", "N s³/m³"),
        ("constant", "nu", "nu", "N"),
        ("ratio", "rad", "m", "m"),
    ],
)
def test_units_of_parameters(role: str, yaw: str, surge: str, newtons: str) -> None:
    assert (YAW.unit_of(role), SURGE.unit_of(role), SURGE.unit_of(role, "N")) == (yaw, surge, newtons)
    assert HEAVE.unit_of(role) == SWAY.unit_of(role) == surge


def test_positions_in_the_units_of_people_and_of_logs() -> None:
    assert YAW.shown(YAW.inner(90.0)) == pytest.approx(90.0) == YAW.logged(YAW.inner(90.0))
    for dof in (SURGE, SWAY, HEAVE):
        assert dof.shown(dof.inner(0.5)) == 50.0 and dof.logged(dof.inner(0.5)) == 0.5
