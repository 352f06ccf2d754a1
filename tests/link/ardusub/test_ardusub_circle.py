"""From a plan to a model on ArduSub: served, played, collected, checked and fitted, the truth known."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from fake_ardusub import FakeSub, Tank
from made_link import MODEL_FILE, TOKEN, vehicle_at

from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub

pytestmark = pytest.mark.slow
TRUTH = {"I_r": 0.8, "k_rr": 1.2}
LIMITS = """
schema = "automarine/plan-limits/1"
[pool]
runs = 6
minutes = 15
wait_s = 5
wait_after_long_turn_s = 10
[moments]
largest = 0.6
[goal]
use_earlier_runs = false
"""


@pytest.mark.parametrize(("frame", "gain"), [(1, 0.75), (2, 1.0)])
def test_a_campaign_on_ardusub_is_true(run: Callable[..., Result], tmp_path: Path, frame: int, gain: float) -> None:
    guess, limits = tmp_path / "guess.json", tmp_path / "limits.toml"
    guess.write_text(json.dumps(MODEL_FILE))
    limits.write_text(LIMITS)
    planned = run("plan", str(guess), "--limits", str(limits), "-o", str(tmp_path / "plan"))
    assert planned.exit_code == 0, planned.stderr
    vehicle = FakeSub(**TRUTH, frame=frame, gain=gain)
    sub = ArduSub(vehicle.address, clock=Tank(vehicle))
    with vehicle_at(tmp_path / "vehicle", 50.0, sub) as served:
        asked = ["collect", served.url, "--token", TOKEN, "-o", str(tmp_path / "pool")]
        collected = run(*asked, "--campaign", str(tmp_path / "plan"), "--json")
        assert collected.exit_code == 0, collected.stderr
    (state,) = json.loads(collected.stdout)["state"]["campaigns"]
    assert (state["played"], state["interrupted"], state["why_stopped"]) == (state["runs"], 0, None)
    logs = sorted((tmp_path / "pool").glob("*.csv"))
    assert len(logs) == state["runs"] >= 6 and not vehicle.armed
    checked = run("check", str(tmp_path / "pool"))
    assert checked.exit_code == 0, checked.stdout
    fitted = run("fit-yaw", str(tmp_path / "pool"), "--fit-to", "whole-runs", "-o", str(tmp_path / "yaw"))
    assert fitted.exit_code == 0, fitted.stderr
    model = json.loads((tmp_path / "yaw/yaw_model.json").read_text())["models"]["3"]
    for name, truth in TRUTH.items():
        assert abs(model[name]["value"] - truth) < 3.0 * model[name]["stderr"] < 0.01 * truth
    assert abs(vehicle.turned / 360.0) <= 0.6  # the tether
