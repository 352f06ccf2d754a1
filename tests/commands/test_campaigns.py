"""`automarine run` of several campaigns: a folder each, an overview, and one that is refused stops no other."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from figures import drawn

from automarine_cli.commands.run import names_of, run_campaign
from automarine_cli.commands.verify import verify
from automarine_cli.errors import SettingError
from automarine_cli.pipeline import parallel

EARLY = "fit-yaw"


def tree(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def season(small_day: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two days in the pool, and one whose campaign file names logs that are not there."""
    place = tmp_path_factory.mktemp("season")
    for day in ("monday", "tuesday"):
        shutil.copytree(small_day / "pool", place / "season" / day)
    bad = place / "season" / "lost.toml"
    bad.write_text('schema = "automarine/campaign/1"\n[logs]\nsteps = ["nowhere"]\n', encoding="utf-8")
    return place


def days(season: Path) -> list[Path]:
    return [season / "season" / "monday" / "campaign.toml", season / "season" / "tuesday" / "campaign.toml"]


@pytest.fixture(scope="module")
def done(season: Path) -> Path:
    run_campaign([*days(season), season / "season" / "lost.toml"], out=season / "out", until=EARLY)
    return season / "out"


def test_each_campaign_is_done_as_if_alone(small_day: Path, season: Path, done: Path) -> None:
    for day in days(season):
        assert tree(small_day / "out") == tree(done / day.parent.name)


def test_the_overview_tells_all_and_the_refused_one_stops_nothing(season: Path, done: Path) -> None:
    overview = json.loads((done / "campaigns.json").read_text(encoding="utf-8"))
    assert overview["schema"] == "automarine/campaigns/1"
    by_name = {one["name"]: one for one in overview["campaigns"]}
    assert list(by_name) == ["monday", "tuesday", "lost"]
    assert by_name["monday"]["refused"] == [] and by_name["tuesday"]["title"] == "A small campaign"
    said = {step["step"]: step["says"] for step in by_name["tuesday"]["steps"]}
    assert said["fit-yaw"].startswith("model 3: k_r|r| 1.")
    (why,) = by_name["lost"]["refused"]
    assert why.startswith("lost.toml: logs.steps: ") and "no such file" in why
    assert (done / "campaigns.csv").read_text(encoding="utf-8").count("\n") == 4
    assert verify([done], inputs=[season]).whole


@pytest.mark.slow
def test_processes_give_the_same_bytes(season: Path, tmp_path: Path) -> None:
    for jobs in (1, 2):
        with drawn():
            files = [*days(season), season / "season" / "lost.toml"]
            run_campaign(files, out=tmp_path / f"{jobs}", until="fit-thrusters", jobs=jobs)
    assert tree(tmp_path / "1") == tree(tmp_path / "2")


def test_a_cluster_gets_whole_paths_of_the_common_disk(
    season: Path, done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers have another working directory; one campaign alone goes there too."""
    mapped = parallel.ordered_map

    def elsewhere(function, tasks, jobs, *, cluster=None, **how):  # type: ignore[no-untyped-def]
        if cluster is None:
            return mapped(function, tasks, jobs, **how)
        assert cluster == "tcp://there:1" and all(path.is_absolute() for task in tasks for path in task[1:])
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path)
            return mapped(function, tasks, 1)

    monkeypatch.setattr(parallel, "ordered_map", elsewhere)
    shutil.copytree(season / "season", tmp_path / "season")
    monkeypatch.chdir(tmp_path / "season")
    run_campaign("monday/campaign.toml", out="out", until="check", cluster="tcp://there:1")
    here = tmp_path / "season" / "out" / "campaign" / "check"
    assert tree(here) == tree(done / "monday" / "check")


def test_what_is_done_is_kept_and_a_changed_log_is_not(season: Path, tmp_path: Path) -> None:
    shutil.copytree(season / "season", tmp_path / "season")
    place = [tmp_path / "season" / day / "campaign.toml" for day in ("monday", "tuesday")]
    run_campaign(place, out=tmp_path / "out", until="check")
    before = tree(tmp_path / "out")
    log = next((tmp_path / "season" / "tuesday" / "steps").glob("*.csv"))
    log.unlink()
    run_campaign(place, out=tmp_path / "out", until="check")
    after = tree(tmp_path / "out")
    changed = {name.split("/")[0] for name in before if before[name] != after[name]}
    assert "tuesday" in changed and "monday" not in changed


@pytest.mark.parametrize(
    ("given", "names"),
    [
        (["a/one.toml", "a/two.toml"], ["one", "two"]),
        (["a/x/campaign.toml", "a/y/campaign.toml"], ["x", "y"]),
        (["a/x/campaign.toml", "b/x/campaign.toml"], ["a/x", "b/x"]),
        (["a/x/pool.toml", "b/sea.toml"], ["a/x/pool", "b/sea"]),
    ],
)
def test_folders_are_named_by_what_tells_the_campaigns_apart(given: list[str], names: list[str]) -> None:
    assert names_of([Path(one) for one in given]) == names


@pytest.mark.parametrize("given", [["a/one.toml", "a/../a/one.toml"], ["a/x.toml", "a/x/campaign.toml"]])
def test_campaigns_that_would_share_a_folder_are_refused(given: list[str]) -> None:
    with pytest.raises(SettingError, match=r"; (name|give)"):
        names_of([Path(one) for one in given])


def test_the_command_line(season: Path, tmp_path: Path, run: Callable[..., Result]) -> None:
    given = [str(path) for path in [*days(season), season / "season" / "lost.toml"]]
    nowhere = run("run", *given, "--until", "check")
    assert nowhere.exit_code == 2 and "-o DIR" in nowhere.stderr
    result = run("run", *given, "--until", "check", "-o", str(tmp_path / "out"))
    assert result.exit_code == 1
    assert "monday" in result.stdout and "Error: lost: lost.toml: logs.steps" in result.stderr
    as_json = run("run", *given[:2], "--until", "check", "-o", str(tmp_path / "out"), "--json")
    assert as_json.exit_code == 0
    assert [one["name"] for one in json.loads(as_json.stdout)["campaigns"]] == ["monday", "tuesday"]
