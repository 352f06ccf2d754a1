"""What each motion calls things, and the keys of its files."""

import pickle

import pytest

from automarine_cli.dofs import DOFS, HEAVE, SURGE, YAW, Dof

TRANSLATIONS = (SURGE, HEAVE)


@pytest.mark.parametrize("dof", DOFS.values(), ids=list(DOFS))
def test_an_axis_is_one_object_in_every_process(dof: Dof) -> None:
    assert pickle.loads(pickle.dumps(dof)) is dof


def test_yaw_says_what_it_says() -> None:
    assert YAW.say("The heading turns 3 degrees; k_r|r|, I_r [nu s²]") == (
        "The heading turns 3 degrees; k_r|r|, I_r [nu s²]"
    )
    assert YAW.named({"I_r": 1, "k_rr": {"moment_unit": "nu"}}) == {"I_r": 1, "k_rr": {"moment_unit": "nu"}}


def test_surge_and_heave_speak_of_force_and_metres() -> None:
    said = "Inertial turn angle I_r/k_r|r|: 0.8 rad, whatever the moment's unit; heading noise 1.00°."
    assert (
        SURGE.say(said)
        == "Inertial distance m_u/X_u|u|: 0.8 m, whatever the force's unit; distance noise 1.00 cm."
    )
    assert HEAVE.say("turned to port by $I_r$ and $k_{r|r|}$") == "moved up by $m_w$ and $Z_{w|w|}$"


def test_equations_and_labels_have_the_letters_of_the_motion() -> None:
    assert SURGE.equation("-k_rr |r| r") == "-X_uu |u| u" and HEAVE.equation("-e r²") == "-e r²".replace(
        "r", "w"
    )
    assert YAW.equation("-k_rr |r| r") == "-k_rr |r| r"
    assert (
        HEAVE.say(r"Size of the moment |τ|, $s\sqrt{k_{r|r|}}/I_r)$")
        == r"Size of the force |Z|, $s\sqrt{Z_{w|w|}}/m_w)$"
    )


@pytest.mark.parametrize("dof", TRANSLATIONS, ids=("surge", "heave"))
def test_names_of_files_and_effects_are_left_alone(dof: Dof) -> None:
    for name in ("bias-moment", "heading-moment", "logs/port/yaw.csv", "port_run", "thruster-map"):
        assert dof.say(name) == name


@pytest.mark.parametrize("dof", TRANSLATIONS, ids=("surge", "heave"))
def test_keys_come_back(dof: Dof) -> None:
    content = {
        "models": {"3": {"I_r": 1.0, "k_rr": {"value": 2.0}}},
        "moment_unit": "N",
        "heading_noise_deg": 1.0,
    }
    named = dof.named(content)
    assert {"moment_unit", "heading_noise_deg", "I_r"}.isdisjoint({*named, *named["models"]["3"]})
    assert dof.plain(named) == content


@pytest.mark.parametrize("dof", TRANSLATIONS, ids=("surge", "heave"))
def test_units_are_those_of_a_force_over_speeds(dof: Dof) -> None:
    assert [dof.unit_of(name, "N") for name in ("inertia", "linear", "quadratic", "ratio")] == [
        "kg", "N s/m", "N s²/m²", "m",
    ]  # fmt: skip
    assert [dof.unit_of(name, "N") for name in (dof.symbols.inertia, dof.symbols.cubic)] == ["kg", "N s³/m³"]
    assert dof.unit_in("{force} s²{/x2}", "nu") == "nu s²/m²" and dof.unit_in("{x}/s", "nu") == "m/s"
