"""`serve` and `collect` at the prompt: what they print and refuse, their exit statuses, and `collect --then run`."""

import json
import os
import signal
import subprocess
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import Result
from link_processes import ALONE, free_port
from link_requests import logs_in, put
from made_link import BATTERY, MODEL, MODEL_FILE, TOKEN, expected_logs, made_campaign, vehicle_at

from automarine_cli.errors import SettingError
from automarine_cli.link.collector import Client, Collector
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.base import Halted
from automarine_cli.link.vehicles.simulated import Simulated

Run = Callable[..., Result]


@pytest.fixture
def model(tmp_path: Path) -> str:
    file = tmp_path / "yaw_model.json"
    file.write_text(json.dumps(MODEL_FILE))
    return str(file)


def written(folder: Path, campaign: LinkCampaign) -> list[str]:
    (folder / "campaign.json").write_text(campaign.text)
    return ["--campaign", str(folder / "campaign.json")]


def test_a_dry_run_and_a_campaign_beyond_the_battery(run: Run, model: str, tmp_path: Path) -> None:
    dry = ["serve", str(tmp_path / "v"), "--vehicle", "simulated", "--model", model, "--dry-run"]
    dry += written(tmp_path, made_campaign(2))
    assert "2 runs in 0.2 min; 100 % of the battery is left, 20 % must be." in run(*dry).stdout
    planned = json.loads(run(*dry, "--json").stdout)["planned"]
    assert [one["begins_s"] for one in planned] == [0.0, 7.0]
    assert planned[0]["turned_deg"] > 0 > planned[1]["turned_deg"]
    beyond = written(tmp_path, replace(made_campaign(4), battery=replace(BATTERY, charge_Ah=0.01)))
    for command in (dry, ["collect", "http://127.0.0.1:9", "-o", str(tmp_path / "pool"), *beyond]):
        refused = run(*command)
        assert refused.exit_code == 1
        assert "the battery does not carry this campaign: in run " in refused.stderr
    assert not (tmp_path / "v").exists()


def test_what_is_missing_is_wrong_usage(run: Run, tmp_path: Path) -> None:
    serve = ["serve", str(tmp_path), "--vehicle"]
    for usage in (["simulated"], ["can"], ["ardusub"], ["can", "--bus", "virtual:x", "--dry-run"]):
        assert run(*serve, *usage).exit_code == 2
    assert run("collect", "http://127.0.0.1:9").exit_code == 2
    assert run("collect", "127.0.0.1", "-o", str(tmp_path / "pool")).exit_code == 1


def test_ardusub_goes_by_the_clock_and_needs_an_address(run: Run, tmp_path: Path) -> None:
    serve, dry = (
        ["serve", str(tmp_path / "v"), "--vehicle", "ardusub"],
        ["--dry-run", *written(tmp_path, made_campaign(2))],
    )
    for options, says in (
        (["udpin:127.0.0.1:0", "--speed", "2", *dry], "goes by the clock; leave out --speed"),
        (["log.tlog"], "expected udpin:0.0.0.0:PORT"),
        (["udpin:127.0.0.1:0", "--full", "0.5", *dry], "and the whole output gives 0.5; plan with"),
    ):
        refused = run(*serve, "--mavlink", *options)
        assert refused.exit_code == 1 and says in refused.stderr
    assert run(*serve, "--mavlink", "udpin:127.0.0.1:0", "--depth-limit", "0", *dry).exit_code == 2


def test_collect_brings_the_same_names_and_bytes(run: Run, tmp_path: Path) -> None:
    campaign = made_campaign(2)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(tmp_path / "pool")]
        assert "Next" not in run(*asked).stdout  # nothing is here
        collected = run(*asked, *written(tmp_path, campaign))
        assert collected.exit_code == 0 and "Next: automarine init" in collected.stdout, collected.stderr
        assert "2 logs fetched" in collected.stdout and "2 of 2" in collected.stdout
        again = json.loads(run(*asked, "--json").stdout)
        assert (again["schema"], again["new"], again["bytes"]) == ("automarine/collected/1", 0, 0)
        changed = tmp_path / "pool" / next(iter(expected_logs(campaign)))
        changed.write_text("changed")
        assert run(*asked).exit_code == 1
        assert run(*asked, "--overwrite").exit_code == 0
    assert logs_in(tmp_path / "pool") == expected_logs(campaign)
    assert run("check", str(tmp_path / "pool")).exit_code == 0


def test_a_token_comes_from_file_or_environment(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, wrong = tmp_path / "token", ["--token", "wrong"]
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        collect = ["collect", vehicle.url, "-o", str(tmp_path / "pool"), "--wait", "60"]
        monkeypatch.setenv("AUTOMARINE_TOKEN", TOKEN)
        assert run(*collect).exit_code == 0
        refused = run(*collect, *wrong)
        assert refused.exit_code == 1 and "refuses the token; give the one that serve printed" in refused.stderr
        file.write_text(f"{TOKEN}\n")
        assert run(*collect, *wrong, "--token-file", str(file)).exit_code == 0
        file.write_text("\n")
        refused = run(*collect, "--token-file", str(file))
        assert refused.exit_code == 1 and f"{file} holds no token; write the one" in " ".join(refused.stderr.split())
    assert run(*collect, "--token-file", str(tmp_path / "none")).exit_code == 2


def test_a_campaign_that_ended_before_its_last_run_is_no_success(run: Run, tmp_path: Path) -> None:
    class Broken(Simulated):
        def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
            if number == 1:
                raise SettingError("the vehicle does not arm")
            return (yield from super().drive(campaign, number, halted))

    campaign = made_campaign(3)
    with vehicle_at(tmp_path / "vehicle", drives=Broken(MODEL, 500.0)) as vehicle:
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(tmp_path / "pool")]
        collected = run(*asked, *written(tmp_path, campaign))
        says = f"Error: campaign {campaign.id[:8]} ended after 1 of 3 runs: the vehicle does not arm\n"
        assert (collected.exit_code, collected.stderr) == (1, says) and "1 of 3" in collected.stdout
        assert "1 logs fetched" in collected.stdout and len(logs_in(tmp_path / "pool")) == 1
        assert run(*asked).exit_code == 0  # what is there was asked for, and is here


def test_serve_tells_address_token_and_what_becomes_of_campaigns(model: str, tmp_path: Path) -> None:
    port = free_port(os.getpid())
    whole, large = made_campaign(2), replace(made_campaign(2), battery=replace(BATTERY, at_moment=9.0))
    large = replace(large, runs=(replace(large.runs[0], commands=((5.0, 1.0),)),))
    command = [*ALONE, "serve", str(tmp_path / "v"), "--vehicle", "simulated", "--model", model, "--speed", "1000"]
    command += ["--address", f"127.0.0.1:{port}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None and server.stderr is not None
        assert server.stdout.readline() == f"http://127.0.0.1:{port}\n"
        token, file = server.stdout.readline().removeprefix("token: ").strip(), tmp_path / "v" / "token"
        assert token == file.read_text().strip() and len(token) >= 32 and file.stat().st_mode & 0o077 == 0
        second = subprocess.run(command, capture_output=True, text=True, check=False)
        assert second.returncode == 1 and "is served already; end that `automarine serve`" in second.stderr
        client = Client.of(f"http://127.0.0.1:{port}", token)
        with pytest.raises(SettingError, match=r"the vehicle refuses: run 01_step_.* asks for a moment of 5 nu"):
            Collector(client, tmp_path / "pool", 60.0).collect(large, stop=False)
        Collector(client, tmp_path / "pool", 60.0).collect(whole, stop=False)
        news = [server.stderr.readline() for _ in range(3)]
        server.send_signal(signal.SIGTERM)
        assert server.wait(timeout=600) == 130
        assert server.stderr.read() == "Interrupted; nothing was left half written.\n"
    assert news[0].startswith(f"campaign {large.id[:8]} is refused: run 01_step_+0.400 asks for a moment of 5 nu, and")
    assert news[1:] == [f"campaign {whole.id[:8]} is accepted\n", f"campaign {whole.id[:8]} ended after 2 of 2 runs\n"]
    assert not (tmp_path / "v" / "lease").exists()


@pytest.mark.parametrize("address", ["::1:8722", "[::1]", "8722", "a:b", ":1"])
def test_an_address_to_listen_on_that_is_none(run: Run, model: str, tmp_path: Path, address: str) -> None:
    refused = run("serve", str(tmp_path / "v"), "--vehicle", "simulated", "--model", model, "--address", address)
    assert refused.exit_code == 1 and "expected HOST:PORT, such as 0.0.0.0:8722 or [::1]:8722" in refused.stderr


# `collect --then run`: when a campaign is over its logs are analysed, all of them, and not before

CAMPAIGN = 'schema = "automarine/campaign/1"\n[logs]\nsteps = [{}]\n'


@pytest.mark.slow
def test_the_logs_of_a_campaign_that_is_over_are_analysed(run: Run, tmp_path: Path) -> None:
    pool = tmp_path / "pool"
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(pool), "--then", "run"]
        early = run(*asked)
        assert early.exit_code == 0 and "No analysis was started: the vehicle has no campaign" in early.stdout
        collected = run(*asked, *written(tmp_path, made_campaign(6)))
        assert collected.exit_code == 0, collected.stderr
        assert "6 logs fetched" in collected.stdout and "6 logs, 6 runs" in collected.stdout
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
        collected = run(*asked, *written(tmp_path, campaign))
        assert collected.exit_code == 1 and not (pool / "analysis").exists()
        assert f"leaves out 1 of 2 logs, such as {names[1]}; add them, or move the file away" in collected.stderr
        (pool / "campaign.toml").write_text(CAMPAIGN.format(", ".join(f'"{name}"' for name in names)))
        few = run(*asked)
        assert few.exit_code == 0 and "2 runs are too few" in few.stdout + few.stderr


def test_a_campaign_that_was_stopped_is_not_analysed(run: Run, tmp_path: Path) -> None:
    with vehicle_at(tmp_path / "vehicle", speed=1.0) as vehicle:
        put(vehicle.port, made_campaign(3, seconds=60.0))
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(tmp_path / "pool"), "--then", "run"]
        playing = run(*asked)
        assert "No analysis was started: a campaign is still played; run the same command again" in playing.stdout
        stopped = run(*asked, "--stop")
        assert stopped.exit_code == 0 and "No analysis was started: the last campaign was stopped" in stopped.stdout
        assert not (tmp_path / "pool" / "analysis").exists()
