"""`run` takes surge, sway and yaw together as a section of a campaign file, and `init` offers it."""

import shutil
from pathlib import Path

import pytest
from repository import SAMPLE_RUNS

from automarine_cli.commands.init import init
from automarine_cli.errors import SettingError
from automarine_cli.workflows.campaign_file import read_campaign
from automarine_cli.workflows.campaign_steps import STEPS

OWN = ["fit-planar", "validate-planar", "diagnose-planar"]


def test_a_campaign_has_these_steps_where_it_has_such_logs() -> None:
    planar, pool = (read_campaign(SAMPLE_RUNS / f"{name}.toml") for name in ("planar_day", "pool_day"))
    assert [one.name for one in STEPS if one.motion == "planar"] == OWN
    assert {one.name for one in STEPS if one.belongs_to(planar)} - {
        one.name for one in STEPS if one.belongs_to(pool)
    } == set(OWN)
    assert len(planar.every_log()) == 10


def test_the_steps_take_their_logs(tmp_path: Path) -> None:
    campaign = read_campaign(SAMPLE_RUNS / "planar_day.toml")
    fit, validation, diagnosis = (one.plan for one in STEPS if one.motion == "planar")
    assert len(fit(campaign, tmp_path).asked.logs) == 8  # type: ignore[union-attr]
    for plan in (validation, diagnosis):
        assert plan(campaign, tmp_path) == "it needs the planar model, and fit-planar gave none"
    (tmp_path / "planar").mkdir()
    shutil.copy(SAMPLE_RUNS / "planar_bare.json", tmp_path / "planar" / "planar_model.json")
    assert len(validation(campaign, tmp_path).asked.logs) == 2  # type: ignore[union-attr]
    plan = diagnosis(campaign, tmp_path)
    assert not isinstance(plan, str) and len(plan.asked.logs) == 8 and len(plan.asked.hold_out) == 2


def test_init_offers_it(tmp_path: Path) -> None:
    for name in ("planar", "planar_validation", "heave"):
        shutil.copytree(SAMPLE_RUNS / name, tmp_path / name)
    made = init(tmp_path)
    assert made.questions == ()
    asked = read_campaign(tmp_path / "campaign.toml").asked
    assert asked.planar is not None
    assert asked.planar.runs == ("planar",) and asked.planar.validation == ("planar_validation",)
    assert not asked.logs.steps and not asked.logs.manoeuvres and "heave" in made.survey.forces


def test_thrusters_need_an_arm(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    file.write_text('schema = "automarine/campaign/1"\n[planar]\nruns = ["x"]\nforce = "thrusters"\n')
    with pytest.raises(SettingError, match=r"which needs vehicle\.arm_m; give it in metres"):
        read_campaign(file)
