"""`automarine run` of several campaigns: a folder each, an overview, and one that is refused stops no other."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from repository import tree

from automarine_cli.commands.run import names_of, run_campaign
from automarine_cli.commands.verify import verify
from automarine_cli.errors import SettingError


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
