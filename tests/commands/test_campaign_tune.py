"""A campaign that ends with the gains of a controller: made once, kept, shown in the report."""

import shutil
from functools import partial
from pathlib import Path

import pytest

from automarine_cli.commands import load
from automarine_cli.commands.campaign import read_campaign
from automarine_cli.commands.report import report
from automarine_cli.commands.run import run_campaign, why_made_again
from automarine_cli.control import tuning
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.parallel import silent
from automarine_cli.report.campaign import STEPS, headlines, read_steps


def test_a_campaign_ends_with_gains_and_its_report_shows_them(
    small_day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a diagnosis the model is tuned; nothing is made again that has not changed."""
    monkeypatch.setattr(tuning, "design", partial(tuning.design, count=40))
    shutil.copytree(small_day, tmp_path / "day")
    campaign, out = tmp_path / "day" / "pool" / "campaign.toml", tmp_path / "day" / "out"
    with campaign.open("a") as file:
        file.write('[tune]\ntarget = "python"\nfull = 1.0\ndelay = 0.05\n')
    first = run_campaign(campaign, out=out, until="fit-yaw")
    assert "tune" not in {one.step for one in first.steps}
    planned, (step,) = read_campaign(campaign), (step for step in STEPS if step.name == "tune")
    settings, tune = planned.plan(step, out), load("tune")
    assert not isinstance(settings, str) and planned.has(step)
    tune.run(settings, out=out / "tune", overwrite=False, jobs=1, progress=silent, figure_formats=("png",))
    assert why_made_again(out / "tune", **tune.manifest(settings)) is None
    assert (out / "tune" / "controller.py").is_file()
    text = report(out, overwrite=True).files["report.md"]
    assert "## Tuning" in text and "(tune/tuning.png)" in text and "### What it rests on" in text
    assert headlines(read_steps(out, [step])) == {"tune": "gains for python"}


def test_a_setting_that_there_is_not_is_refused_with_its_key(small_day: Path, tmp_path: Path) -> None:
    shutil.copytree(small_day / "pool", tmp_path / "pool")
    campaign = tmp_path / "pool" / "campaign.toml"
    with campaign.open("a") as file:
        file.write('[tune]\ntarget = "python"\nfulll = 1.0\n')
    with pytest.raises(SettingError, match="fulll"):
        run_campaign(campaign, out=tmp_path / "out")


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ("full = 1", r"^campaign\.toml: tune\.target is missing"),
        ('target = "pid"\nfull = -1', r"^campaign\.toml: tune\.full is -1; -1\.0 is not in the range x>0"),
        ('target = "pid"\nthrusters = 1', r"^campaign\.toml: tune\.thrusters: found 1, expected true or false"),
        ('target = "pid"\npresent = "no.param"', r"^campaign\.toml: tune\.present: there is no file no\.param"),
    ],
)
def test_settings_are_those_of_the_command(tmp_path: Path, lines: str, says: str) -> None:
    campaign = tmp_path / "campaign.toml"
    campaign.write_text(f'schema = "automarine/campaign/1"\n[logs]\nsteps = ["x"]\n[tune]\n{lines}\n')
    with pytest.raises(SettingError, match=says):
        read_campaign(campaign)


def test_the_campaign_s_thruster_map_is_flown(small_day: Path, tmp_path: Path) -> None:
    """Its own map with the vehicle's arm; without a map it says so."""
    (step,) = (step for step in STEPS if step.name == "tune")
    shutil.copytree(small_day, tmp_path / "day")
    campaign, out = tmp_path / "day" / "pool" / "campaign.toml", tmp_path / "day" / "out"
    with campaign.open("a") as file:
        file.write('[tune]\ntarget = "python"\nthrusters = true\n')
    known = read_campaign(campaign)
    (out / "yaw").mkdir(parents=True, exist_ok=True)
    (out / "yaw" / "yaw_model.json").touch()
    fitted = out / "thrusters" / "thrusters.json"
    fitted.unlink(missing_ok=True)
    assert known.plan(step, out) == "it needs the thruster map, and fit-thrusters gave none"
    fitted.parent.mkdir(parents=True, exist_ok=True)
    fitted.touch()
    plan = known.plan(step, out)
    assert not isinstance(plan, str)
    assert plan["thrusters"] == fitted and plan["arm"] is None
