"""`automarine run CAMPAIGN.toml`: every step in order, what has not changed is kept, and why a step runs."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from click.testing import Result
from few_candidates import few_candidates
from figures import drawn
from small_campaign import CAMPAIGN, make_small_campaign

from automarine_cli.commands.run import run_campaign
from automarine_cli.commands.verify import verify
from automarine_cli.errors import OutputError, SettingError
from automarine_cli.report.campaign import CampaignRun

EARLY = "fit-yaw"  # as far as most of these tests go: a second of work
FEW = ("dead-band", "bias-moment")  # will do for a diagnosis here


@pytest.fixture
def place(small_day: Path, tmp_path: Path) -> Path:
    """A copy that a test may spoil."""
    return Path(shutil.copytree(small_day, tmp_path / "copy"))


def again(place: Path, **how: object) -> CampaignRun:
    given = {"until": EARLY, **how}
    return run_campaign(place / "pool" / "campaign.toml", out=place / "out", **given)  # type: ignore[arg-type]


def fates(result: CampaignRun) -> dict[str, str]:
    return {one.step: one.did for one in result.steps}


def reasons(result: CampaignRun) -> dict[str, str]:
    return {one.step: one.why for one in result.steps}


def tree(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def edit(place: Path, old: str, new: str) -> None:
    file = place / "pool" / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


class Whole(NamedTuple):
    """A campaign done to its end after its first steps, on one process: where, the result, and what was told."""

    place: Path
    result: CampaignRun
    told: list[str]


@pytest.fixture(scope="module")
def whole(small_day: Path, tmp_path_factory: pytest.TempPathFactory) -> Whole:
    place = Path(shutil.copytree(small_day, tmp_path_factory.mktemp("whole") / "copy"))
    told: list[str] = []

    def progress(stage: str, done: int, total: int) -> None:
        if ": " not in stage or total == 0:
            told.append(re.sub(r"\d+ s ", "SECONDS s ", f"{stage} {done}/{total}"))

    with few_candidates(FEW):
        return Whole(place, again(place, until=None, progress=progress), told)


def test_whole_campaign(whole: Whole) -> None:
    place, first, told = whole
    assert fates(first) == {
        "check": "kept", "fit-thrusters": "kept", "fit-yaw": "kept",
        "validate": "done", "diagnose": "done", "report": "done",
    }  # fmt: skip
    assert told[4:8] == [
        "3/6 fit-yaw 2/6", "3/6 fit-yaw: kept (inputs, settings and versions unchanged) 0/0",
        "4/6 validate 3/6", "4/6 validate: done, SECONDS s (no result yet) 0/0",
    ]  # fmt: skip
    found = tree(place / "out")
    assert {"report.html", "report.md", "run.json", "manifest.json", "yaw/drag.svg", "yaw/drag.png"} <= set(found)
    assert first.says["check"] == "10 logs, 10 runs, 1 without a half-turn"
    assert first.says["fit-yaw"].startswith("model 3: k_r|r| 1.2")
    assert first.says["diagnose"].startswith("nothing missing")  # though one run never moved
    (stuck,) = json.loads(found["diagnosis/diagnosis.json"])["runs"]["set_aside"]
    assert stuck["run"] == "tau_-0.6_still" and "never moved" in stuck["why"]
    assert json.loads(found["run.json"]) == first.to_json()
    assert verify([place / "out"], inputs=[place]).whole
    held_out = json.loads(found["diagnosis/diagnosis.json"])["held_out"]
    assert held_out == ["there_and_back"]  # validation runs are never fitted

    kept = again(place, until=None)
    assert set(fates(kept).values()) == {"kept"}
    assert tree(place / "out") == found
    assert kept.says == first.says


@pytest.mark.slow
def test_same_bytes_of_every_step_on_two_processes_and_elsewhere(small_day: Path, tmp_path: Path) -> None:
    trees = []
    for jobs, place in ((1, tmp_path / "here"), (2, tmp_path / "far" / "away")):
        shutil.copytree(small_day / "pool", place / "pool")
        with drawn(), few_candidates(FEW):
            made = run_campaign(place / "pool" / "campaign.toml", out=place / "out", jobs=jobs)
        assert set(fates(made).values()) == {"done"}
        trees.append(tree(place / "out"))
    one, two = trees
    assert [name for name in sorted(one | two) if one.get(name) != two.get(name)] == []
    assert {"diagnosis/diagnosis.json", "validation/validation.json", "report.html", "run.json"} <= set(one)


def test_nothing_runs_twice(place: Path) -> None:
    before = tree(place / "out")
    found = again(place)
    assert fates(found) == {"check": "kept", "fit-thrusters": "kept", "fit-yaw": "kept"}
    assert tree(place / "out") == before
    assert not (place / "out" / "run.json").exists()  # the report was not asked for


def test_a_step_runs_for_its_inputs(place: Path) -> None:
    log = next((place / "pool" / "steps").glob("tau_+0.3*.csv"))
    log.write_text(log.read_text(encoding="utf-8").replace(",0.3", ",0.31"), encoding="utf-8")
    found = again(place)
    assert fates(found) == {"check": "done", "fit-thrusters": "kept", "fit-yaw": "done"}
    assert reasons(found)["fit-yaw"] == f"inputs changed: steps/{log.name}"
    log.unlink()
    assert reasons(again(place))["fit-yaw"] == f"inputs changed: steps/{log.name} (gone)"


def test_a_step_runs_for_its_settings(place: Path) -> None:
    edit(place, "per_test = 2", "per_test = 1")
    found = again(place)
    assert fates(found) == {"check": "kept", "fit-thrusters": "done", "fit-yaw": "kept"}
    assert reasons(found)["fit-thrusters"] == "settings changed: thrusters_per_test"


def test_a_step_runs_for_another_version(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from automarine_cli.pipeline import results_folder

    newer = {**results_folder.versions_here(), "numpy": "99.0"}
    monkeypatch.setattr(results_folder, "versions_here", lambda: newer)
    found = again(place, until="check")
    assert fates(found) == {"check": "done"}
    assert reasons(found)["check"].startswith("version: numpy ") and "99.0 now" in reasons(found)["check"]


def test_a_result_that_was_touched_is_made_again(place: Path) -> None:
    file = place / "out" / "thrusters" / "thrusters.json"
    whole = file.read_bytes()
    file.write_bytes(whole.replace(b"square", b"cubic!"))
    found = again(place)
    assert reasons(found)["fit-thrusters"] == "results changed since they were written: thrusters.json"
    assert file.read_bytes() == whole


def test_force_and_until(place: Path) -> None:
    assert fates(again(place, force=True, until="check")) == {"check": "done"}
    with pytest.raises(SettingError, match="until is 'fit'; 'fit' is not one of 'check', 'fit-thrusters'"):
        again(place, until="fit")


def test_steps_without_logs_are_skipped_and_their_former_results_go(place: Path) -> None:
    edit(place, 'thrusters = ["thrusters"]\n', "")
    found = again(place)
    assert fates(found)["fit-thrusters"] == "skipped"
    assert reasons(found)["fit-thrusters"] == ("the campaign names no thruster tests; its former result was removed")
    assert not (place / "out" / "thrusters").exists()


def test_a_refused_step_is_told_and_the_others_go_on(place: Path, run: Callable[..., Result]) -> None:
    for log in (place / "pool" / "steps").glob("tau_*"):
        if "still" not in log.name:
            log.unlink()
    (place / "pool" / "driving").rename(place / "pool" / "elsewhere")
    edit(place, "driving", "elsewhere")
    found = run("run", place / "pool" / "campaign.toml", "-o", place / "out")
    assert found.exit_code == 1
    assert "Error: fit-yaw: " in found.stderr
    content = json.loads((place / "out" / "run.json").read_text(encoding="utf-8"))
    steps = {one["step"]: one for one in content["steps"]}
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
    assert (place / "out" / "report.html").exists()


def test_too_few_runs_for_a_diagnosis_are_no_refusal(place: Path, run: Callable[..., Result]) -> None:
    """Nothing can be corrected: the step is skipped, the report says why, and the exit status is 0."""
    for log in sorted((place / "pool" / "steps").glob("tau_*"))[3:]:
        log.unlink()
    edit(place, 'manoeuvres = ["driving/*.csv"]\n', "")
    found = run("run", place / "pool" / "campaign.toml", "-o", place / "out")
    assert found.exit_code == 0, found.stderr
    steps = {one["step"]: one for one in json.loads((place / "out" / "run.json").read_text(encoding="utf-8"))["steps"]}
    assert "too few to tell a missing effect from chance" in steps["diagnose"]["skipped"]
    assert "| diagnose | skipped: " in (place / "out" / "report.md").read_text(encoding="utf-8")


def test_moments_of_the_thrusters(place: Path) -> None:
    edit(place, "[thrusters]", '[vehicle]\narm_m = 0.1\n[yaw]\nmoment = "thrusters"\n[thrusters]')
    found = again(place)  # these logs have no thruster commands
    assert fates(found)["fit-yaw"] == "refused"
    assert "no thruster command n_port or n_stbd" in reasons(found)["fit-yaw"]
    edit(place, "arm_m = 0.1\n", "")
    with pytest.raises(SettingError, match=r"needs vehicle\.arm_m; give it in metres"):
        again(place)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[logs]", "[log]", 'campaign.toml: unknown key "log"; did you mean "logs"?'),
        ("per_test = 2", "per_tests = 2", 'campaign.toml: thrusters: unknown key "per_tests"'),
        ("per_test = 2", 'per_test = "?"', "campaign.toml: 1 question is still open: thrusters.per_test; write"),
        ("campaign/1", "campaign/9", "expected 'automarine/campaign/1'"),
        ("per_test = 2", "per_test = 0", "campaign.toml: thrusters.per_test is 0; 0 is not in the range x>=1"),
        ('["steps"]', '["step"]', "campaign.toml: logs.steps: "),
        ("[thrusters]", "[columns]\nheading = 'yaw'\n[thrusters]", "campaign.toml: columns.heading: no column"),
    ],
)
def test_campaign_files_are_refused_by_key(
    place: Path, run: Callable[..., Result], old: str, new: str, says: str
) -> None:
    edit(place, old, new)
    found = run("run", place / "pool" / "campaign.toml", "-o", place / "out")
    assert found.exit_code == 1
    assert found.stderr.startswith("Error: ") and says in found.stderr
    assert len(found.stderr.splitlines()) == 1


def test_results_of_others_are_not_replaced(place: Path) -> None:
    with pytest.raises(OutputError, match="already holds results of fit-yaw; give --overwrite"):
        run_campaign(place / "pool" / "campaign.toml", out=place / "out" / "yaw", until="check")


def test_another_campaign_needs_overwrite(tmp_path: Path) -> None:
    first = make_small_campaign(tmp_path / "pool")
    first.write_text(CAMPAIGN.replace('steps = ["steps"]\nmanoeuvres = ["driving/*.csv"]\n', ""), encoding="utf-8")
    made = run_campaign(first, out=tmp_path / "out")
    assert fates(made) == {
        "check": "done", "fit-thrusters": "done", "fit-yaw": "skipped", "validate": "skipped",
        "diagnose": "skipped", "report": "done",
    }  # fmt: skip
    other = first.rename(first.with_name("other.toml"))
    with pytest.raises(OutputError, match=r"results of the campaign campaign\.toml; give --overwrite"):
        run_campaign(other, out=tmp_path / "out")
    kept = run_campaign(other, out=tmp_path / "out", overwrite=True)
    assert fates(kept)["check"] == "kept" and fates(kept)["report"] == "done"


def test_without_out_results_stand_beside_the_campaign(place: Path, run: Callable[..., Result]) -> None:
    found = run("run", place / "pool" / "campaign.toml", "--until", "check")
    assert found.exit_code == 0
    assert f"Results are in {place / 'pool' / 'results'}: check/" in found.stdout
    assert (place / "pool" / "results" / "check" / "check.json").is_file()
    kept = run_campaign(place / "pool" / "campaign.toml", until="check")
    assert fates(kept) == {"check": "kept"}


def test_wrong_usage(place: Path, run: Callable[..., Result]) -> None:
    campaign = place / "pool" / "campaign.toml"
    assert run("run").exit_code == 2
    assert run("run", campaign, "--until", "fit").exit_code == 2


def test_json_is_the_result_file(place: Path, run: Callable[..., Result]) -> None:
    found = run("run", place / "pool" / "campaign.toml", "-o", place / "out", "--until", "check", "--json", "-v")
    content = json.loads(found.stdout)
    assert (content["schema"], content["title"]) == ("automarine/run/1", "A small campaign")
    assert found.stderr.splitlines() == ["1/1 check: kept (inputs, settings and versions unchanged)."]
