"""`run` takes every motion and `tune` as sections of a campaign file, and `init` writes the sections that it takes."""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from repository import SAMPLE_RUNS

from automarine_cli.commands import load
from automarine_cli.commands.campaign import Campaign, NothingToDoError, read_campaign
from automarine_cli.commands.report import report
from automarine_cli.commands.run import run_campaign, why_made_again
from automarine_cli.control import design
from automarine_cli.errors import AutomarineError
from automarine_cli.pipeline.parallel import silent
from automarine_cli.report.campaign import STEPS, headlines, make_report, read_steps

STEP = {step.name: step for step in STEPS}
HEAVE = f"""[heave]
steps = ["{SAMPLE_RUNS / "heave"}"]
validation = ["{SAMPLE_RUNS / "heave_validation"}"]
depths = [0, 3.6]
tail = 1.1
"""
YAW = f'[logs]\nsteps = ["{SAMPLE_RUNS / "steps"}"]\n'


def campaign_file(folder: Path, text: str) -> Path:
    file = folder / "campaign.toml"
    file.write_text(f'schema = "automarine/campaign/1"\n{text}\n')
    return file


def settings(campaign: Campaign, step: str, out: Path) -> Mapping[str, Any]:
    return campaign.plan(STEP[step], out)


def nothing_to_do(campaign: Campaign, step: str, out: Path) -> str:
    with pytest.raises(NothingToDoError) as reason:
        settings(campaign, step, out)
    return str(reason.value)


@pytest.mark.slow
def test_heave_has_its_own_steps_and_report(tmp_path: Path) -> None:
    file, out = campaign_file(tmp_path, HEAVE), tmp_path / "out"
    result = run_campaign(file, out=out, until="validate-heave")
    assert {step.step: step.did for step in result.steps} == {
        "check": "done", "fit-thrusters": "skipped", "fit-yaw": "skipped", "validate": "skipped",
        "diagnose": "skipped", "validate-final": "skipped", "fit-heave": "done", "validate-heave": "done",
    }  # fmt: skip
    assert (
        result.says["fit-heave"].startswith("model 3 (quadratic drag): Z_ww 45")
        and "cm free run" in result.says["validate-heave"]
    )
    options = json.loads((out / "heave" / "manifest.json").read_text())["options"]
    assert options["tail"] == 1.1 and options["depths"] == [0, 3.6]
    again = run_campaign(file, out=out, until="validate-heave")
    assert {step.step: step.did for step in again.steps}["validate-heave"] == "kept"
    text = make_report(out).files["report.md"]
    for part in (
        "## Heave model",
        "| fit-heave | model 3 (quadratic drag): ",
        "Buoyancy: a constant force of 2",
        "## Heave validation",
    ):
        assert part in text
    assert "## Yaw model" not in text and "heave/steps.png" in text


def test_a_section_has_the_settings_of_its_command(tmp_path: Path) -> None:
    """Converted as those of the command line; what a later step has too goes to that as well."""
    lines = (
        '[thrusters]\nform = "square"\n[yaw]\nfit_to = "whole-runs"\nwith_effects = ["dead-band"]\ntail = 90.0\n'
        'channels = "position"\nknown = { I_r = [1, 0.1], k_r = 0 }\n'
    )
    campaign = read_campaign(campaign_file(tmp_path, f"seed = 3\n{YAW}{lines}"))
    (tmp_path / "yaw").mkdir()
    (tmp_path / "yaw" / "yaw_model.json").touch()
    fit, diagnosis = (settings(campaign, name, tmp_path) for name in ("fit-yaw", "diagnose"))
    assert fit["with_effects"] == ("dead-band",) and fit["known"] == ("I_r=1±0.1", "k_r=0")
    assert (fit["fit_to"], fit["channels"], len(fit["logs"])) == ("whole-runs", "position", 42)
    assert fit["tail"] == pytest.approx(90.0)  # degrees, as on the command line
    assert (diagnosis["channels"], diagnosis["seed"], diagnosis["hold_out"]) == ("position", 3, ())
    assert campaign.sections["thrusters"] == {"form": "square"}
    assert nothing_to_do(campaign, "validate", tmp_path) == "the campaign names no validation runs"


@pytest.mark.parametrize(("line", "why"), [
    ("within = 3.0", 'heave: unknown key "within"'), ("depths = [1.0]", r"heave\.depths is \[1\.0\]; "),
    ('force = "guessed"', r'heave\.force: found "guessed", expected "logged" or "thrusters"'),
    ("taill = 1.0", 'heave: unknown key "taill"; did you mean "tail"'), ("steps = 'heave'", r"heave\.steps: found"),
    ('steps = ["no"]', r"heave\.steps"), ("tail = -1.0", r"heave\.tail is -1; expected metres above 0"),
    (f"{YAW}[yaw]\ntail = 170.0", r"yaw\.tail is 170; expected 15 to 165 degrees"),
    ('[planar]\nruns = ["x"]\nforce = "thrusters"', r"which needs vehicle\.arm_m; give it in metres"),
    (f"{YAW}[tune]\nfull = 1", r"^campaign\.toml: tune\.target is missing"),
    (f'{YAW}[tune]\nfor = "pid"', r'tune: unknown key "for"; did you mean "target"\?'),
    (f'{YAW}[tune]\ntarget = "pid"\nfull = -1', r"tune\.full is -1; -1\.0 is not in the range x>0"),
    (f'{YAW}[tune]\ntarget = "pid"\nthrusters = 1', r"tune\.thrusters: found 1, expected true or false"),
    ('[thrusters]\nper_test = "?"', "^campaign.toml: 1 question is still open: thrusters.per_test; write"),
    (f"{YAW}[columns]\nheading = 'yaw'", "^campaign.toml: columns.heading: no column"),
    ('[', "^campaign.toml: not valid TOML: "),
    (f'{YAW}[tune]\ntarget = "pid"\npresent = "no.param"', r"tune\.present: there is no file no\.param"),
])  # fmt: skip
def test_what_makes_no_sense_is_refused_with_its_key(tmp_path: Path, line: str, why: str) -> None:
    """A line takes the place of that of HEAVE with its key; a section stands alone."""
    others = "\n".join(other for other in HEAVE.splitlines() if not other.startswith(line.partition(" ")[0]))
    file = campaign_file(tmp_path, line if "[" in line[:1] else f"{others}\n{line}")
    with pytest.raises(AutomarineError, match=why):
        run_campaign(file)


@pytest.fixture
def day(small_day: Path, tmp_path: Path) -> Path:
    """A copy of a small campaign, with a section `tune` to end it."""
    shutil.copytree(small_day, tmp_path / "day")
    with (tmp_path / "day" / "pool" / "campaign.toml").open("a") as file:
        file.write('[tune]\ntarget = "pid"\nfull = 1.0\ndelay = 0.05\n')
    return tmp_path / "day"


def test_a_campaign_ends_with_gains_and_its_report_shows_them(day: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a diagnosis the model is tuned; nothing is made again that has not changed."""
    monkeypatch.setattr(design, "CROWD_VEHICLES", 12)
    campaign, out = day / "pool" / "campaign.toml", day / "out"
    assert "tune" not in {step.step for step in run_campaign(campaign, out=out, until="fit-yaw").steps}
    plan, tune = settings(read_campaign(campaign), "tune", out), load("tune")
    tune.run(plan, out=out / "tune", overwrite=False, jobs=1, progress=silent, figure_formats=("png",))
    assert why_made_again(out / "tune", **tune.manifest(plan)) is None
    assert (out / "tune" / "pid.json").is_file()
    text = report(out, overwrite=True).files["report.md"]
    assert "## Tuning" in text and "(tune/tuning.png)" in text and "### What it rests on" in text
    assert headlines(read_steps(out, [STEP["tune"]])) == {"tune": "gains for pid"}


def test_gains_take_the_thruster_map_of_the_campaign(day: Path) -> None:
    with (day / "pool" / "campaign.toml").open("a") as file:
        file.write("thrusters = true\n")
    campaign, fitted = read_campaign(day / "pool" / "campaign.toml"), day / "out" / "thrusters" / "thrusters.json"
    plan = settings(campaign, "tune", day / "out")
    assert plan["thrusters"] == fitted and plan["arm"] is None
    fitted.unlink()
    assert nothing_to_do(campaign, "tune", day / "out") == "it needs the thruster map, and fit-thrusters gave none"
