"""A campaign that ends with the gains of a controller: made once, kept, shown in the report."""

import shutil
from pathlib import Path

import pytest

from automarine_cli.control import design
from automarine_cli.errors import SettingError
from automarine_cli.workflows.run import run_campaign


def test_a_campaign_ends_with_gains_and_its_report_shows_them(
    small_day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a diagnosis the model is tuned; nothing is made again that has not changed."""
    monkeypatch.setattr(design, "CROWD", 40)
    shutil.copytree(small_day, tmp_path / "day")
    campaign, out = tmp_path / "day" / "pool" / "campaign.toml", tmp_path / "day" / "out"
    with campaign.open("a") as file:
        file.write('[tune]\ntarget = "python"\nfull = 1.0\ndelay = 0.05\n')
    first = run_campaign(campaign, out=out, until="fit-yaw")
    assert "tune" not in {one.step for one in first.news}
    from automarine_cli.workflows.campaign_steps import STEPS

    (step,) = (one for one in STEPS if one.name == "tune")
    from automarine_cli.workflows.campaign_file import read_campaign

    plan = step.plan(read_campaign(campaign), out)
    assert not isinstance(plan, str) and step.belongs_to(read_campaign(campaign))
    plan.run(out / "tune", False, 1, lambda *_: None)
    assert plan.why(out / "tune") is None
    assert (out / "tune" / "controller.py").is_file()
    from automarine_cli.workflows.report import report

    made = report(out, overwrite=True)
    text = made.files["report.md"]
    assert "## Tune" in text and "(tune/tuning.png)" in text and "### What it rests on" in text
    assert step.work.kept is not None and step.work.kept.outcome(out / "tune") == "gains for python"


def test_a_setting_that_there_is_not_is_refused_with_its_key(small_day: Path, tmp_path: Path) -> None:
    shutil.copytree(small_day / "pool", tmp_path / "pool")
    campaign = tmp_path / "pool" / "campaign.toml"
    with campaign.open("a") as file:
        file.write('[tune]\ntarget = "python"\nfulll = 1.0\n')
    with pytest.raises(SettingError, match="fulll"):
        run_campaign(campaign, out=tmp_path / "out")


def test_the_campaign_s_thruster_map_is_flown(small_day: Path, tmp_path: Path) -> None:
    """Its own map with the vehicle's arm; without a map it says so."""
    from automarine_cli.pipeline.records import Source
    from automarine_cli.workflows.campaign_file import read_campaign
    from automarine_cli.workflows.campaign_steps import STEPS

    (step,) = (one for one in STEPS if one.name == "tune")
    shutil.copytree(small_day, tmp_path / "day")
    campaign, out = tmp_path / "day" / "pool" / "campaign.toml", tmp_path / "day" / "out"
    with campaign.open("a") as file:
        file.write('[tune]\ntarget = "python"\nthrusters = true\n')
    known = read_campaign(campaign)
    (out / "yaw").mkdir(parents=True, exist_ok=True)
    (out / "yaw" / "yaw_model.json").touch()
    fitted = out / "thrusters" / "thrusters.json"
    fitted.unlink(missing_ok=True)
    assert step.plan(known, out) == "it needs the thruster map, and fit-thrusters gave none"
    fitted.parent.mkdir(parents=True, exist_ok=True)
    fitted.touch()
    plan = step.plan(known, out)
    assert not isinstance(plan, str) and isinstance(fitted, Source)
    assert vars(plan.asked)["thrusters"] == fitted and vars(plan.asked)["arm"] == known.asked.vehicle.arm_m
