"""`automarine export --to thrusters`: each form read back gives the map's thrust, or the refusal says how far it is."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from export_readers import LAWS, constants_of
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from repository import SAMPLE_RUNS

import automarine_cli as am
from automarine_cli import exports as targets
from automarine_cli.commands.export import export
from automarine_cli.errors import SettingError
from automarine_cli.exports.base import number
from automarine_cli.exports.thrusters import deviation, table
from automarine_cli.thrusters.curves import PowerCurve, SplineCurve
from automarine_cli.thrusters.map import ThrusterMap

Floats = NDArray[np.float64]
FORMS = list(targets.get("thrusters").forms)
N_MAX = 150.0
SQUARE = ThrusterMap("square", PowerCurve(2.6e-4), PowerCurve(0.7e-4))
EVEN = ThrusterMap("square", PowerCurve(2.6e-4), PowerCurve(2.6e-4))
BANDED = ThrusterMap("dead-band", PowerCurve(3.0e-4, n_0=12.0), PowerCurve(1.0e-4, n_0=18.0))
POWER = ThrusterMap(
    "dead-band-power-saturation", PowerCurve(3.0e-3, 1.5, 10.0, 120.0), PowerCurve(1.1e-3, 1.6, 14.0, 120.0)
)
SPLINE = ThrusterMap(
    "spline",
    SplineCurve((0.0, 20.0, 60.0, 150.0), (0.0, 0.0, 2.0, 5.0)),
    SplineCurve((0.0, 20.0, 150.0), (0.0, 0.0, 3.0)),
)
AHEAD_ONLY = ThrusterMap("square", PowerCurve(2.6e-4), None)


def map_file(folder: Path, map_: ThrusterMap, full_scale: float | None = None) -> Path:
    """A thrusters.json, with the full scale that drives it to N_MAX if none is given."""
    top = float(np.max(np.abs(map_.force(np.array([N_MAX])))))
    path = folder / "thrusters.json"
    path.write_text(json.dumps(map_.to_json() | {"full_scale_N": top if full_scale is None else full_scale}))
    return path


def signals() -> Floats:
    """Control signals of both directions, the largest included."""
    return np.linspace(-N_MAX, N_MAX, 1201)


@pytest.mark.parametrize("form", [form for form in FORMS if form != "gz-thruster"])
def test_a_square_map_is_exact_in_every_form_but_gazebos(tmp_path: Path, form: str) -> None:
    assert list(LAWS) == FORMS
    file = export(map_file(tmp_path, SQUARE), to="thrusters", form=form)
    expected, close = SQUARE.force(signals()), 1e-3 if form.endswith("table") else 1e-6
    np.testing.assert_allclose(LAWS[form](file.text)(signals()), expected, atol=close * np.max(expected))
    assert "Warning" not in file.text and file.carried == ("thruster map",)
    assert file.text.isascii() and "Thrust is positive ahead, in both frames alike." in file.text


@pytest.mark.parametrize("map_", [BANDED, POWER, SPLINE], ids=["dead-band", "power", "spline"])
def test_tables_follow_any_map(tmp_path: Path, map_: ThrusterMap) -> None:
    law = LAWS["uuv-table"](export(map_file(tmp_path, map_), to="thrusters", form="uuv-table").text)
    expected = map_.force(signals())
    np.testing.assert_allclose(law(signals()), expected, atol=1.1e-3 * np.max(np.abs(expected)))
    assert np.all(law(np.array([-5.0, 0.0, 5.0])) == 0.0)


@given(
    a=st.floats(1e-6, 1e2), p=st.floats(0.4, 4.0), n_0=st.floats(0.0, 100.0), limit=st.floats(101.0, 900.0),
    n_max=st.floats(105.0, 1000.0),
)  # fmt: skip
def test_tables_are_sound_for_any_curve(a: float, p: float, n_0: float, limit: float, n_max: float) -> None:
    map_ = ThrusterMap("dead-band-power-saturation", PowerCurve(a, p, n_0, limit), PowerCurve(a / 3, p, 0.0, None))
    n, force = table(map_, n_max)
    assert np.all(np.diff(n) > 0) and n[0] == -n[-1] and 0.0 in n
    assert [float(number(x)) for x in n] == list(n)
    off, full = deviation(map_, lambda x: np.interp(x, n, force), n_max)
    assert off < 2e-3 * full


def test_a_map_of_another_shape_is_refused_with_its_error(tmp_path: Path) -> None:
    path, refused = (
        map_file(tmp_path, BANDED),
        r"constants .*up to 0\.24 N \(4\.2 % .*give --allow-partial, or --form uuv",
    )
    with pytest.raises(SettingError, match=rf"^thrusters\.json: {refused}"):
        export(path, to="thrusters", form="constants")
    partly = export(path, to="thrusters", form="constants", allow_partial=True)
    off = np.max(np.abs(LAWS["constants"](partly.text)(signals()) - BANDED.force(signals())))
    assert f"{off:.2g} N" == "0.24 N" and "0.24 N" in partly.text


def test_gazebo_is_symmetric_and_says_what_that_costs(tmp_path: Path) -> None:
    path = map_file(tmp_path, SQUARE)
    with pytest.raises(SettingError, match=r"one coefficient for both directions .* up to 2\.1 N .* give --symmetrise"):
        export(path, to="thrusters", form="gz-thruster")
    text = export(path, to="thrusters", form="gz-thruster", symmetrise=True).text
    law = LAWS["gz-thruster"](text)
    assert np.max(np.abs(law(signals()) - SQUARE.force(signals()))) == pytest.approx(2.14, abs=0.01)
    assert "Warning: the thrust of this file is wrong by up to 2.1 N" in text
    even = export(map_file(tmp_path, EVEN), to="thrusters", form="gz-thruster").text
    np.testing.assert_allclose(LAWS["gz-thruster"](even)(signals()), EVEN.force(signals()), atol=1e-6)
    assert "Warning" not in even


def test_saturation_is_a_limit_of_the_signal(tmp_path: Path) -> None:
    limited = ThrusterMap("square-saturation", PowerCurve(2.6e-4, n_sat=100.0), PowerCurve(0.7e-4, n_sat=80.0))
    path = map_file(tmp_path, limited)
    law = LAWS["constants"](export(path, to="thrusters", form="constants", n_max=N_MAX).text)
    np.testing.assert_allclose(law(signals()), limited.force(signals()), atol=1e-6)


def test_a_direction_that_was_never_measured_is_refused(tmp_path: Path) -> None:
    path = map_file(tmp_path, AHEAD_ONLY)
    with pytest.raises(SettingError, match=r"^thrusters\.json: backward was never measured; give --allow-partial"):
        export(path, to="thrusters")
    for form in FORMS[:-1]:
        text = export(path, to="thrusters", form=form, allow_partial=True).text
        law = LAWS[form](text)
        assert law(np.array([-100.0]))[0] == 0.0 and law(np.array([100.0]))[0] == pytest.approx(2.6, rel=2e-3)
        assert "backward was never measured" in text


def test_a_propellers_lag_is_the_simulators_own(tmp_path: Path) -> None:
    path = map_file(tmp_path, SQUARE)
    text = {form: export(path, to="thrusters", form=form, lag=0.25).text for form in FORMS[:-1]}
    assert constants_of(text["constants"])["T_n"] == 0.25
    assert ET.fromstring(text["uuv-table"]).findtext(".//dynamics[type='FirstOrder']/timeConstant") == "0.25"
    with pytest.raises(SettingError, match="--lag means nothing to gz-thruster"):
        export(path, to="thrusters", form="gz-thruster", symmetrise=True, lag=0.25)


def test_how_far_the_thruster_goes_must_be_known(tmp_path: Path) -> None:
    path = tmp_path / "thrusters.json"
    path.write_text(json.dumps(SQUARE.to_json()))
    with pytest.raises(SettingError, match="does not tell how far the thruster was driven; give --n-max"):
        export(path, to="thrusters")
    assert constants_of(export(path, to="thrusters", n_max=90.0).text)["n_max"] == 90.0


def test_a_thruster_that_never_leaves_its_dead_band_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"^thrusters\.json: backward .* its dead band of 18; give a larger --n-max"):
        export(map_file(tmp_path, BANDED), to="thrusters", n_max=15.0, allow_partial=True)


def test_yaw_targets_refuse_a_map_and_python_takes_the_fit_itself(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"thrusters\.json is a thruster map; --to uuv takes a yaw model"):
        export(map_file(tmp_path, SQUARE), to="uuv")
    fit = am.fit_thrusters(SAMPLE_RUNS / "thrusters", thrusters_per_test=2)
    assert constants_of(am.export(fit, to="thrusters").text)["k_pos"] == pytest.approx(2.626e-4, rel=1e-3)
