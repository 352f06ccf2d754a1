"""`collect --then run`: when a campaign is over its logs are analysed, all of them, and not before."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from made_link import TOKEN, expected_logs, made_campaign, vehicle_at
from test_link_cuts import put

Run = Callable[..., Result]
CAMPAIGN = 'schema = "automarine/campaign/1"\n[logs]\nsteps = [{}]\n'


@pytest.mark.slow
def test_the_logs_of_a_campaign_that_is_over_are_analysed(run: Run, tmp_path: Path) -> None:
    campaign, pool = made_campaign(6), tmp_path / "pool"
    (tmp_path / "campaign.json").write_text(campaign.text)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(pool), "--then", "run"]
        early = run(*asked)
        assert early.exit_code == 0 and "No analysis was started: the vehicle has no campaign" in early.stdout
        found = run(*asked, "--campaign", str(tmp_path / "campaign.json"))
        assert found.exit_code == 0, found.stderr
        assert "6 logs fetched" in found.stdout and "6 logs, 6 runs" in found.stdout
        model = json.loads((pool / "analysis" / "yaw" / "yaw_model.json").read_text())
        inertia = model["models"][model["preferred"]]["I_r"]
        assert inertia["ci95"][0] < 1.0 < inertia["ci95"][1]
        page = (pool / "analysis" / "report.html").read_bytes()
        again = json.loads(run(*asked, "--json").stdout)
        assert (again["new"], again["analysis"]["schema"]) == (0, "automarine/run/1")
        assert (pool / "analysis" / "report.html").read_bytes() == page


def test_a_campaign_file_that_is_there_is_the_one_that_is_run(run: Run, tmp_path: Path) -> None:
    campaign, pool = made_campaign(2), tmp_path / "pool"
    names = list(expected_logs(campaign))
    pool.mkdir()
    (pool / "campaign.toml").write_text(CAMPAIGN.format(f'"{names[0]}"'))
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        put(vehicle.port, campaign)
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(pool), "--then", "run"]
        (tmp_path / "campaign.json").write_text(campaign.text)
        found = run(*asked, "--campaign", str(tmp_path / "campaign.json"))
        assert found.exit_code == 1 and not (pool / "analysis").exists()
        assert f"leaves out 1 of 2 logs, such as {names[1]}; add them, or move the file away" in found.stderr
        (pool / "campaign.toml").write_text(CAMPAIGN.format(", ".join(f'"{name}"' for name in names)))
        few = run(*asked)
        assert few.exit_code == 0 and "2 runs are too few" in few.stdout + few.stderr


def test_a_campaign_that_was_stopped_is_not_analysed(run: Run, tmp_path: Path) -> None:
    with vehicle_at(tmp_path / "vehicle", speed=20.0) as vehicle:
        put(vehicle.port, made_campaign(3, seconds=60.0))
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(tmp_path / "pool"), "--then", "run"]
        playing = run(*asked)
        assert "No analysis was started: a campaign is still played; run the same command again" in playing.stdout
        stopped = run(*asked, "--stop")
        assert stopped.exit_code == 0 and "No analysis was started: the last campaign was stopped" in stopped.stdout
        assert not (tmp_path / "pool" / "analysis").exists()
