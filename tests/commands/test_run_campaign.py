"""`automarine run CAMPAIGN.toml`: every step in order, what has not changed is kept, and why a step runs."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from few_candidates import few_candidates
from figures import drawn
from repository import SAMPLE_RUNS, tree
from small_campaign import CAMPAIGN, make_small_campaign

from automarine_cli.commands.run import run_campaign
from automarine_cli.commands.verify import verify
from automarine_cli.errors import OutputError, SettingError
from automarine_cli.pipeline import results_folder
from automarine_cli.report.campaign import CampaignRun, read_steps

EARLY = "fit-yaw"  # as far as most of these tests go: a second of work
FEW = ("dead-band", "bias-moment")  # will do for a diagnosis here


@pytest.fixture
def place(small_day: Path, tmp_path: Path) -> Path:
    """A copy that a test may spoil."""
    return Path(shutil.copytree(small_day, tmp_path / "copy"))


def again(place: Path, **how: object) -> CampaignRun:
    settings = {"until": EARLY, **how}
    return run_campaign(place / "pool" / "campaign.toml", out=place / "out", **settings)  # type: ignore[arg-type]


def fates(result: CampaignRun) -> dict[str, str]:
    return {step.step: step.did for step in result.steps}


def reasons(result: CampaignRun) -> dict[str, str]:
    return {step.step: step.why for step in result.steps}


def edit(place: Path, old: str, new: str) -> None:
    file = place / "pool" / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


def test_a_campaign_done_to_its_end_is_kept_whole(place: Path) -> None:
    lines: list[str] = []

    def progress(stage: str, done: int, total: int) -> None:
        if ": " not in stage or total == 0:
            lines.append(re.sub(r"\d+ s ", "SECONDS s ", f"{stage} {done}/{total}"))

    with few_candidates(FEW, curves=False):
        result = again(place, until=None, progress=progress)
    assert fates(result) == {
        "check": "kept", "fit-thrusters": "kept", "fit-yaw": "kept",
        "validate": "done", "diagnose": "done", "validate-final": "skipped", "report": "done",
    }  # fmt: skip
    assert lines[4:8] == [
        "3/7 fit-yaw 2/7", "3/7 fit-yaw: kept (inputs, settings and versions unchanged) 0/0",
        "4/7 validate 3/7", "4/7 validate: done, SECONDS s 0/0",
    ]  # fmt: skip
    written = tree(place / "out")
    assert {"report.html", "report.md", "run.json", "manifest.json", "yaw/drag.svg", "yaw/drag.png"} <= set(written)
    assert result.says["diagnose"].startswith("nothing missing")  # though one run never moved
    diagnosis = json.loads(written["diagnosis/diagnosis.json"])
    (aside,) = diagnosis["runs"]["set_aside"]
    assert aside["run"] == "tau_-0.6_still" and "never moved" in aside["why"]
    assert diagnosis["held_out"] == ["there_and_back"]  # validation runs are never fitted
    assert json.loads(written["run.json"]) == result.to_json()
    assert verify([place / "out"], inputs=[place]).whole

    second = again(place, until=None)
    assert set(fates(second).values()) == {"kept", "skipped"} and second.says == result.says
    assert tree(place / "out") == written


HIDDEN = """
schema = "automarine/campaign/1"
[logs]
steps = ["hidden_one/tau_*[26].csv"]
manoeuvres = ["hidden_one/reversal_*"]
validation = ["hidden_one/falling.csv", "hidden_one/there_and_back.csv"]
"""


def test_the_final_model_is_validated_where_an_effect_was_named(tmp_path: Path, run: Callable[..., Result]) -> None:
    """The swirl hidden in the samples: with it noise and thrust explain the restarted error, without it they do not."""
    shutil.copytree(SAMPLE_RUNS / "hidden_one", tmp_path / "hidden_one")
    (tmp_path / "campaign.toml").write_text(HIDDEN, encoding="utf-8")
    with few_candidates(("water-swirl", "dead-band"), curves=False):
        shown = run("run", tmp_path / "campaign.toml", "-o", tmp_path / "out")
    first, *_, error = [line for line in shown.stdout.partition("\nResults are in")[0].splitlines() if line]
    assert first.startswith("Named: water-swirl. ") and error.startswith(
        "Heading error of the model with water-swirl: "
    )
    assert "because" not in shown.stdout and "skipped  the campaign names no thruster tests" in shown.stdout
    steps = read_steps(tmp_path / "out")
    before, after = steps["validation"].file, steps["final_validation"].file
    assert after.models["3"].restarted < 2.0 * after.expected < before.models["3"].restarted
    assert after.models["3"].rmse < 0.5 * before.models["3"].rmse
    text = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert "](final_validation/validation_falling." in text and "](validation/" not in text
    again = run_campaign(tmp_path / "campaign.toml", out=tmp_path / "out", until="validate-final")
    assert fates(again)["validate-final"] == "kept"
    (tmp_path / "campaign.toml").write_text(HIDDEN.replace("validation", "# validation"), encoding="utf-8")
    again = run_campaign(tmp_path / "campaign.toml", out=tmp_path / "out", until="validate")
    assert (tmp_path / "out" / "diagnosis").is_dir() and fates(again)["validate"] == "skipped"


@pytest.mark.slow
def test_same_bytes_of_every_step_on_two_processes_and_elsewhere(small_day: Path, tmp_path: Path) -> None:
    trees = []
    for jobs, folder in ((1, tmp_path / "here"), (2, tmp_path / "far" / "away")):
        shutil.copytree(small_day / "pool", folder / "pool")
        with drawn(), few_candidates(FEW):
            result = run_campaign(folder / "pool" / "campaign.toml", out=folder / "out", jobs=jobs)
        assert [step for step, did in fates(result).items() if did != "done"] == ["validate-final"]  # nothing missing
        trees.append(tree(folder / "out"))
    first, second = trees
    assert [name for name in sorted(first | second) if first.get(name) != second.get(name)] == []
    assert {"diagnosis/diagnosis.json", "validation/validation.json", "report.html", "run.json"} <= set(first)


def test_a_step_runs_for_its_inputs_its_settings_and_its_results(place: Path) -> None:
    before, early = tree(place / "out"), "fit-thrusters"
    assert set(fates(again(place)).values()) == {"kept"} and tree(place / "out") == before
    assert not (place / "out" / "run.json").exists()  # the report was not wanted
    log = next((place / "pool" / "steps").glob("tau_+0.3*.csv"))
    log.write_text(log.read_text(encoding="utf-8").replace(",0.3", ",0.31"), encoding="utf-8")
    result = again(place)
    assert fates(result) == {"check": "done", "fit-thrusters": "kept", "fit-yaw": "done"}
    assert reasons(result)["fit-yaw"] == f"inputs changed: steps/{log.name}"
    log.unlink()
    edit(place, "per_test = 2", "per_test = 1")
    assert reasons(again(place, until=early)) == {
        "check": f"inputs changed: steps/{log.name} (gone)", "fit-thrusters": "settings changed: thrusters_per_test",
    }  # fmt: skip
    file = place / "out" / "thrusters" / "thrusters.json"
    written = file.read_bytes()
    file.write_bytes(written.replace(b"square", b"cubic!"))
    why = reasons(again(place, until=early))["fit-thrusters"]
    assert why == "results changed since they were written: thrusters.json" and file.read_bytes() == written


def test_a_step_runs_for_another_version_and_by_force(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    newer = {**results_folder.versions_here(), "numpy": "99.0"}
    monkeypatch.setattr(results_folder, "versions_here", lambda: newer)
    result = again(place, until="check")
    assert reasons(result)["check"].startswith("version: numpy ") and "99.0 now" in reasons(result)["check"]
    assert fates(again(place, until="check")) == {"check": "kept"}
    assert fates(again(place, until="check", force=True)) == {"check": "done"}
    with pytest.raises(SettingError, match="until is 'fit'; 'fit' is not one of 'check', 'fit-thrusters'"):
        again(place, until="fit")


def test_steps_without_logs_are_skipped_and_their_former_results_go(place: Path) -> None:
    edit(place, 'thrusters = ["thrusters"]\n', "")
    result = again(place)
    assert fates(result)["fit-thrusters"] == "skipped"
    assert reasons(result)["fit-thrusters"] == "the campaign names no thruster tests; its former result was removed"
    assert not (place / "out" / "thrusters").exists()


def test_a_refused_step_is_named_and_the_others_go_on(place: Path, run: Callable[..., Result]) -> None:
    for log in (place / "pool" / "steps").glob("tau_*"):
        if "still" not in log.name:
            log.unlink()
    edit(place, 'manoeuvres = ["driving/*.csv"]\n', "")
    result = run("run", place / "pool" / "campaign.toml", "-o", place / "out")
    assert result.exit_code == 1
    assert "Error: fit-yaw: " in result.stderr
    content = json.loads((place / "out" / "run.json").read_text(encoding="utf-8"))
    steps = {step["step"]: step for step in content["steps"]}
    assert "refused" in steps["fit-yaw"] and "folder" in steps["fit-thrusters"]
    assert steps["validate"]["skipped"] == "it needs the yaw model, and fit-yaw gave none"
    assert not (place / "out" / "yaw").exists()  # a former result would be of other logs
    page = (place / "out" / "report.md").read_text(encoding="utf-8")
    refused, *_ = page.splitlines()[2:]
    assert refused.startswith("**fit-yaw was refused:** ") and "no motion" in refused
    assert "| diagnose | skipped: it needs the yaw model, and fit-yaw gave none |" in page
    assert "not run" not in page and "every run was used" not in page
    assert run("report", place / "out", "--overwrite").exit_code == 0
    assert refused in (place / "out" / "report.md").read_text(encoding="utf-8").splitlines()


def test_too_few_runs_for_a_diagnosis_are_no_refusal(place: Path, run: Callable[..., Result]) -> None:
    """Nothing can be corrected: the step is skipped, the report says why, and the exit status is 0."""
    for log in sorted((place / "pool" / "steps").glob("tau_*"))[3:]:
        log.unlink()
    edit(place, 'manoeuvres = ["driving/*.csv"]\n', "")
    result = run("run", place / "pool" / "campaign.toml", "-o", place / "out")
    assert result.exit_code == 0, result.stderr
    content = json.loads((place / "out" / "run.json").read_text(encoding="utf-8"))
    steps = {step["step"]: step for step in content["steps"]}
    assert "too few to tell a missing effect from chance" in steps["diagnose"]["skipped"]
    assert "| diagnose | skipped: " in (place / "out" / "report.md").read_text(encoding="utf-8")


def test_other_results_are_not_replaced_unless_wanted(place: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="already holds results of fit-yaw; give --overwrite"):
        run_campaign(place / "pool" / "campaign.toml", out=place / "out" / "yaw", until="check")
    first = make_small_campaign(tmp_path / "pool")
    first.write_text(CAMPAIGN.replace('steps = ["steps"]\nmanoeuvres = ["driving/*.csv"]\n', ""), encoding="utf-8")
    run_campaign(first, out=tmp_path / "out")
    other = first.rename(first.with_name("other.toml"))
    with pytest.raises(OutputError, match=r"results of the campaign campaign\.toml; give --overwrite"):
        run_campaign(other, out=tmp_path / "out")
    second = run_campaign(other, out=tmp_path / "out", overwrite=True)
    assert fates(second)["check"] == "kept" and fates(second)["report"] == "done"


def test_without_out_results_stand_beside_the_campaign(place: Path, run: Callable[..., Result]) -> None:
    result = run("run", place / "pool" / "campaign.toml", "--until", "check")
    assert result.exit_code == 0
    assert f"Results are in {place / 'pool' / 'results'}: check/" in result.stdout
    again = run("run", place / "pool" / "campaign.toml", "--until", "check", "--json", "-v")
    content = json.loads(again.stdout)
    assert (content["schema"], content["title"]) == ("automarine/run/1", "A small campaign")
    assert again.stderr.splitlines() == ["1/1 check: kept (inputs, settings and versions unchanged)."]
    assert run("run").exit_code == 2
    assert run("run", place / "pool" / "campaign.toml", "--until", "fit").exit_code == 2
