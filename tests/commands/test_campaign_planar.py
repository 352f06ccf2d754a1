"""`run` takes surge, sway and yaw together as a section of a campaign file, and `init` offers it."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from repository import SAMPLE_RUNS

from automarine_cli.commands.campaign import read_campaign
from automarine_cli.commands.init import init
from automarine_cli.errors import SettingError
from automarine_cli.report.campaign import STEPS


def given(plan: dict[str, Any] | str) -> Mapping[str, Any]:
    assert not isinstance(plan, str)
    return plan


OWN = ["fit-planar", "validate-planar", "diagnose-planar"]


def test_a_campaign_has_these_steps_where_it_has_such_logs() -> None:
    planar, pool = (read_campaign(SAMPLE_RUNS / f"{name}.toml") for name in ("planar_day", "pool_day"))
    assert [step.name for step in STEPS if step.section == "planar"] == OWN
    assert [step.name for step in STEPS if planar.has(step) and not pool.has(step)] == OWN
    assert len(planar.every_log()) == 10


def test_the_steps_take_their_logs(tmp_path: Path) -> None:
    campaign = read_campaign(SAMPLE_RUNS / "planar_day.toml")
    fit, validation, diagnosis = (step for step in STEPS if step.section == "planar")
    assert len(given(campaign.plan(fit, tmp_path))["logs"]) == 8
    for step in (validation, diagnosis):
        assert campaign.plan(step, tmp_path) == "it needs the planar model, and fit-planar gave none"
    (tmp_path / "planar").mkdir()
    shutil.copy(SAMPLE_RUNS / "planar_bare.json", tmp_path / "planar" / "planar_model.json")
    assert len(given(campaign.plan(validation, tmp_path))["logs"]) == 2
    settings = given(campaign.plan(diagnosis, tmp_path))
    assert len(settings["logs"]) == 8 and len(settings["hold_out"]) == 2


def test_init_offers_it(tmp_path: Path) -> None:
    for name in ("planar", "planar_validation", "heave"):
        shutil.copytree(SAMPLE_RUNS / name, tmp_path / name)
    made = init(tmp_path)
    assert made.questions == ()
    campaign = read_campaign(tmp_path / "campaign.toml").sections
    assert campaign["planar"] == {"runs": ["planar"], "validation": ["planar_validation"]}
    assert not campaign["logs"]["steps"] and not campaign["logs"]["manoeuvres"] and "heave" in made.survey.forces


def test_thrusters_need_an_arm(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    file.write_text('schema = "automarine/campaign/1"\n[planar]\nruns = ["x"]\nforce = "thrusters"\n')
    with pytest.raises(SettingError, match=r"which needs vehicle\.arm_m; give it in metres"):
        read_campaign(file)
