"""`automarine run CAMPAIGN.toml`: every step in order, what has not changed is kept, and why a step runs."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from few_candidates import few_candidates
from figures import drawn
from repository import SAMPLE_RUNS, tree
from small_campaign import CAMPAIGN, make_small_campaign

from automarine_cli.commands.run import names_of, run_campaign
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


@pytest.mark.slow
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


# Several campaigns: a folder each, an overview, and one that is refused stops no other


@pytest.fixture(scope="module")
def season(small_day: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two days in the pool, and a campaign file that names logs that are not there."""
    folder = tmp_path_factory.mktemp("season") / "season"
    for day in ("monday", "tuesday"):
        shutil.copytree(small_day / "pool", folder / day)
    (folder / "lost.toml").write_text('schema = "automarine/campaign/1"\n[logs]\nsteps = ["nowhere"]\n')
    return folder


def files(season: Path) -> list[Path]:
    return [season / "monday" / "campaign.toml", season / "tuesday" / "campaign.toml", season / "lost.toml"]


@pytest.fixture(scope="module")
def results(season: Path) -> Path:
    run_campaign(files(season), out=season.parent / "out", until="fit-thrusters")
    return season.parent / "out"


def test_each_campaign_is_done_as_if_alone_and_a_refused_one_stops_nothing(small_day: Path, results: Path) -> None:
    for day in ("monday", "tuesday"):
        alone = {name: data for name, data in tree(small_day / "out").items() if not name.startswith("yaw/")}
        assert alone == tree(results / day)
    overview = json.loads((results / "campaigns.json").read_text(encoding="utf-8"))
    assert overview["schema"] == "automarine/campaigns/1"
    by_name = {campaign["name"]: campaign for campaign in overview["campaigns"]}
    assert list(by_name) == ["monday", "tuesday", "lost"]
    assert by_name["monday"]["refused"] == [] and by_name["tuesday"]["title"] == "A small campaign"
    says = {step["step"]: step["says"] for step in by_name["tuesday"]["steps"]}
    assert "fit-thrusters" in says and says["check"]
    (why,) = by_name["lost"]["refused"]
    assert why.startswith("lost.toml: logs.steps: ") and "no such file" in why
    assert (results / "campaigns.csv").read_text(encoding="utf-8").count("\n") == 4
    assert verify([results], inputs=[results.parent]).whole


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["a/one.toml", "a/two.toml"], ["one", "two"]),
        (["a/x/campaign.toml", "a/y/campaign.toml"], ["x", "y"]),
        (["a/x/campaign.toml", "b/x/campaign.toml"], ["a/x", "b/x"]),
        (["a/x/pool.toml", "b/sea.toml"], ["a/x/pool", "b/sea"]),
        (["a/one.toml", "a/../a/one.toml"], None),  # these would share a folder
        (["a/x.toml", "a/x/campaign.toml"], None),
    ],
)
def test_folders_are_named_by_what_tells_the_campaigns_apart(paths: list[str], names: list[str] | None) -> None:
    if names:
        assert names_of([Path(path) for path in paths]) == names
        return
    with pytest.raises(SettingError, match=r"; (name|give)"):
        names_of([Path(path) for path in paths])


def test_the_command_line(season: Path, tmp_path: Path, run: Callable[..., Result]) -> None:
    nowhere = run("run", *files(season), "--until", "check")
    assert nowhere.exit_code == 2 and "-o DIR" in nowhere.stderr
    result = run("run", *files(season), "--until", "check", "-o", tmp_path / "out")
    assert result.exit_code == 1 and "monday" in result.stdout
    assert "Error: lost: lost.toml: logs.steps" in result.stderr
    result = run("run", *files(season)[:2], "--until", "check", "-o", tmp_path / "out", "--json")
    assert [campaign["name"] for campaign in json.loads(result.stdout)["campaigns"]] == ["monday", "tuesday"]
    assert result.exit_code == 0


# `supply_V`: a supply that the thruster tests do not reach is a caution


POWER = 1.5  # thrust grows so with the voltage
COEFFICIENT = 2.6e-4  # N/n² at 12 V


def campaign(folder: Path, volts: tuple[float, ...]) -> Path:
    """A campaign of one bollard test, pulled at each of these voltages, and of a supply of 16 V."""
    rng = np.random.default_rng(5)
    folder.mkdir()
    levels = np.repeat(np.arange(-150, 151, 15), 2)
    rows = [
        f"{n},{COEFFICIENT * n * abs(n) * (v / 12.0) ** POWER + 0.01 * rng.normal():.5f},{v + 0.02 * rng.normal():.3f}"
        for v in volts
        for n in levels[levels != 0]
    ]
    (folder / "bollard.csv").write_text("\n".join(["n,force_N,voltage_V", *rows, ""]))
    file = folder / "campaign.toml"
    file.write_text(
        'schema = "automarine/campaign/1"\n[vehicle]\nsupply_V = 16.0\n[logs]\nthrusters = ["bollard.csv"]\n'
        "[thrusters]\nper_test = 1\n"
    )
    return file


def test_a_supply_beyond_the_tests_is_a_caution(tmp_path: Path, run: Callable[..., Result]) -> None:
    file, out = campaign(tmp_path / "pool", (12.0, 16.0)), tmp_path / "out"
    text = file.read_text()
    for supply, beyond in ((11.7, False), (22.0, True), (8.0, True)):
        file.write_text(text.replace("16.0", f"{supply}"))
        result = run("run", file, "-o", out)
        assert result.exit_code == 0, result.output
        content = json.loads((out / "run.json").read_text(encoding="utf-8"))
        pages = [(out / name).read_text(encoding="utf-8") for name in ("report.html", "report.md")]
        assert all(("the map is extrapolated" in page) == beyond for page in pages)
        assert len(content["cautions"]) == beyond
        for caution in content["cautions"]:
            assert f"tested at 12.0 to 16.0 V, the vehicle's supply is {supply:.3g}" in caution
            assert caution in " ".join(result.stdout.split())
    assert {step.step: step.did for step in run_campaign(file, out=out).steps}["fit-thrusters"] == "kept"
    log = tmp_path / "pool" / "bollard.csv"
    log.write_text("\n".join(line.rpartition(",")[0] for line in log.read_text().splitlines()) + "\n")
    assert run_campaign(file, out=out).content.cautions == ()  # of tests without any voltage nothing is said
