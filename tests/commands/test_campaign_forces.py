"""`run` takes surge and heave as further sections of a campaign file."""

import json
import shutil
from pathlib import Path

import pytest
from repository import SAMPLE_RUNS

from automarine_cli.commands.campaign import read_campaign
from automarine_cli.commands.init import init
from automarine_cli.commands.run import run_campaign
from automarine_cli.errors import SettingError
from automarine_cli.report.campaign import STEPS, make_report

HEAVE = f"""
schema = "automarine/campaign/1"
title = "Up and down"
[heave]
steps = ["{SAMPLE_RUNS / "heave"}"]
validation = ["{SAMPLE_RUNS / "heave_validation"}"]
depths = [0, 3.6]
tail = 1.1
"""


def test_heave_has_steps_and_a_report_of_its_own(tmp_path: Path) -> None:
    file, out = tmp_path / "campaign.toml", tmp_path / "out"
    file.write_text(HEAVE)
    made = run_campaign(file, out=out, until="validate-heave")
    did = {one.step: one.did for one in made.steps}
    assert list(did) == ["check", "fit-thrusters", "fit-yaw", "validate", "diagnose", "fit-heave", "validate-heave"]
    assert (did["fit-heave"], did["validate-heave"], did["fit-yaw"]) == ("done", "done", "skipped")
    assert made.says["fit-heave"].startswith("model 3: Z_w|w| 45") and "cm free run" in made.says["validate-heave"]
    options = json.loads((out / "heave" / "manifest.json").read_text())["options"]
    assert options["tail"] == 1.1 and options["depths"] == [0, 3.6]
    again = run_campaign(file, out=out, until="validate-heave")
    assert {one.step: one.did for one in again.steps}["validate-heave"] == "kept"
    report = make_report(out).files["report.md"]
    for said in (
        "# Heave identification",
        "## Heave model",
        "| fit-heave | model 3: ",
        "Buoyancy: a constant force of 2",
        "## Heave validation",
    ):
        assert said in report
    assert "## Yaw model" not in report and "heave/steps.png" in report


def test_init_writes_the_sections_that_run_takes(tmp_path: Path) -> None:
    for name in ("surge", "surge_validation", "heave", "heave_validation", "hidden_surge"):
        shutil.copytree(SAMPLE_RUNS / name, tmp_path / name)
    started = init(tmp_path)
    assert started.questions == ()
    campaign = read_campaign(tmp_path / "campaign.toml")
    assert campaign.sections["logs"]["steps"] == []
    counts = {
        (motion, kind): len(campaign.logs(motion, kind))
        for motion in ("surge", "heave")
        for kind in ("steps", "manoeuvres", "validation")
    }
    assert counts == {
        ("surge", "steps"): 34, ("surge", "manoeuvres"): 4, ("surge", "validation"): 3,
        ("heave", "steps"): 1, ("heave", "manoeuvres"): 0, ("heave", "validation"): 3,
    }  # fmt: skip
    assert started.to_json()["surge"]["validation"][0].endswith("surge_validation/falling.csv")


def test_a_campaign_of_yaw_alone_has_no_other_steps() -> None:
    pool, forces = (read_campaign(SAMPLE_RUNS / f"{name}.toml") for name in ("pool_day", "forces"))
    assert {step.section for step in STEPS if pool.has(step)} == {"", "thrusters", "yaw"}
    assert {step.section for step in STEPS if forces.has(step)} == {"", "thrusters", "yaw", "surge", "heave"}


def test_the_tail_of_yaw_is_in_degrees(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    text = f'schema = "automarine/campaign/1"\n[logs]\nsteps = ["{SAMPLE_RUNS / "steps"}"]\n[yaw]\ntail = '
    file.write_text(f"{text}90.0\n")
    assert read_campaign(file).sections["yaw"]["tail"] == 90.0
    file.write_text(f"{text}170.0\n")
    with pytest.raises(SettingError, match=r"^campaign\.toml: yaw\.tail is 170; expected 15 to 165 degrees"):
        read_campaign(file)


def test_a_section_has_the_settings_of_its_command(tmp_path: Path) -> None:
    """Converted as those of the command line; what a later step has too goes to that as well."""
    file = tmp_path / "campaign.toml"
    file.write_text(
        f'schema = "automarine/campaign/1"\nseed = 3\n[logs]\nsteps = ["{SAMPLE_RUNS / "steps"}"]\n'
        '[thrusters]\nform = "square"\n[yaw]\nfit_to = "whole-runs"\nwith_effects = ["dead-band"]\n'
        'channels = "position"\nknown = { I_r = [1, 0.1], k_r = 0 }\n'
    )
    (tmp_path / "yaw").mkdir()
    (tmp_path / "yaw" / "yaw_model.json").touch()
    campaign, steps = read_campaign(file), {step.name: step for step in STEPS}
    fit, diagnosis = (campaign.plan(steps[name], tmp_path) for name in ("fit-yaw", "diagnose"))
    assert isinstance(fit, dict) and isinstance(diagnosis, dict)
    assert fit["with_effects"] == ("dead-band",) and fit["known"] == ("I_r=1±0.1", "k_r=0")
    assert (fit["fit_to"], fit["channels"], fit["tail"], len(fit["logs"])) == ("whole-runs", "position", None, 42)
    assert (diagnosis["channels"], diagnosis["seed"], diagnosis["hold_out"]) == ("position", 3, ())
    assert campaign.sections["thrusters"] == {"form": "square"}
    assert campaign.plan(steps["validate"], tmp_path) == "the campaign names no validation runs"


@pytest.mark.parametrize(("line", "why"), [
    ("within = 3.0", 'heave: unknown key "within"'), ("depths = [1.0]", r"heave\.depths is \[1\.0\]; "),
    ('force = "guessed"', r'heave\.force: found "guessed", expected "logged" or "thrusters"'),
    ("tail = [1.0]", r"heave\.tail is \[1\.0\]; expected a float"), ('tail = "far"', r"heave\.tail is 'far'; "),
    ('fit_to = "half-turns"', r"heave\.fit_to is 'half-turns'; 'half-turns' is not one of"),
    ('with_effects = "nothing"', r"heave\.with_effects: with is 'nothing'; expected effects such as"),
    ("taill = 1.0", 'heave: unknown key "taill"; did you mean "tail"'), ("steps = 'heave'", r"heave\.steps: found"),
    ('steps = ["no"]', "heave.steps"), ("tail = -1.0", r"heave\.tail is -1; expected metres above 0"),
])  # fmt: skip
def test_what_makes_no_sense_is_refused_with_its_key(tmp_path: Path, line: str, why: str) -> None:
    file = tmp_path / "campaign.toml"
    key = line.partition(" ")[0]
    kept = "\n".join(one for one in HEAVE.splitlines() if not one.startswith(key))
    file.write_text(f"{kept}\n{line}\n")
    with pytest.raises(SettingError, match=why):
        run_campaign(file)
