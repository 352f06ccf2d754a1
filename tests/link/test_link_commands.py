"""`serve` and `collect` at the prompt: what they print, what they refuse, and their exit statuses."""

import json
import os
import signal
import socket
import subprocess
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import Result
from link_processes import ALONE, free_port
from made_link import BATTERY, MODEL, TOKEN, expected_logs, made_campaign, vehicle_at
from test_link_cuts import logs_in
from test_link_kills import MODEL_FILE

from automarine_cli.errors import SettingError
from automarine_cli.link.collector import Client, Collector
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.base import Halted
from automarine_cli.link.vehicles.simulated import Simulated

Run = Callable[..., Result]


@pytest.fixture
def model(tmp_path: Path) -> str:
    """A yaw model as a file."""
    file = tmp_path / "yaw_model.json"
    file.write_text(json.dumps(MODEL_FILE))
    return str(file)


def test_a_dry_run_says_what_a_campaign_would_be(run: Run, model: str, tmp_path: Path) -> None:
    campaign = made_campaign(2)
    (tmp_path / "campaign.json").write_text(campaign.text)
    asked = ["serve", str(tmp_path / "v"), "--vehicle", "simulated", "--model", model, "--dry-run"]
    found = run(*asked, "--campaign", str(tmp_path / "campaign.json"))
    assert found.exit_code == 0 and "2 runs in 0.2 min; 100 % of the battery is left, 20 % must be." in found.stdout
    planned = json.loads(run(*asked, "--campaign", str(tmp_path / "campaign.json"), "--json").stdout)["planned"]
    assert [one["begins_s"] for one in planned] == [0.0, 7.0]
    assert planned[0]["turned_deg"] > 0 > planned[1]["turned_deg"]
    assert not (tmp_path / "v").exists()


def test_a_campaign_beyond_the_battery_is_refused_on_both_sides(run: Run, model: str, tmp_path: Path) -> None:
    campaign = replace(made_campaign(4), battery=replace(BATTERY, charge_Ah=0.01))
    file = tmp_path / "campaign.json"
    file.write_text(campaign.text)
    dry = ["serve", str(tmp_path / "v"), "--vehicle", "simulated", "--model", model, "--dry-run"]
    for asked in (dry, ["collect", "http://127.0.0.1:9", "-o", str(tmp_path / "pool")]):
        found = run(*asked, "--campaign", str(file))
        assert found.exit_code == 1 and "the battery does not carry this campaign: in run " in found.stderr


def test_what_is_missing_is_wrong_usage(run: Run, tmp_path: Path) -> None:
    assert run("serve", str(tmp_path), "--vehicle", "simulated").exit_code == 2
    assert run("serve", str(tmp_path), "--vehicle", "replay").exit_code == 2
    assert run("serve", str(tmp_path), "--vehicle", "ardusub").exit_code == 2
    assert run("serve", str(tmp_path), "--vehicle", "replay", "--recordings", str(tmp_path), "--dry-run").exit_code == 2
    assert run("collect", "http://127.0.0.1:9").exit_code == 2
    assert run("collect", "127.0.0.1", "-o", str(tmp_path / "pool")).exit_code == 1


def test_ardusub_goes_by_the_clock_and_needs_an_address(run: Run, tmp_path: Path) -> None:
    (tmp_path / "campaign.json").write_text(made_campaign(2).text)
    asked = ["serve", str(tmp_path / "v"), "--vehicle", "ardusub"]
    dry = ["--dry-run", "--campaign", str(tmp_path / "campaign.json")]
    found = run(*asked, "--mavlink", "udpin:127.0.0.1:0", "--speed", "2", *dry)
    assert found.exit_code == 1 and "goes by the clock; leave out --speed" in found.stderr
    found = run(*asked, "--mavlink", "log.tlog")
    assert found.exit_code == 1 and "expected udpin:0.0.0.0:PORT" in found.stderr
    found = run(*asked, "--mavlink", "udpin:127.0.0.1:0", "--full", "0.5", *dry)
    assert found.exit_code == 1 and "and the whole output gives 0.5; plan with" in found.stderr
    assert run(*asked, "--mavlink", "udpin:127.0.0.1:0", "--depth-limit", "0", *dry).exit_code == 2


def test_collect_brings_the_same_names_and_bytes(run: Run, tmp_path: Path) -> None:
    campaign = made_campaign(2)
    (tmp_path / "campaign.json").write_text(campaign.text)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(tmp_path / "pool")]
        found = run(*asked, "--campaign", str(tmp_path / "campaign.json"))
        assert found.exit_code == 0, found.stderr
        assert "2 logs fetched" in found.stdout and "2 of 2" in found.stdout
        again = json.loads(run(*asked, "--json").stdout)
        assert (again["schema"], again["new"], again["bytes"]) == ("automarine/collected/1", 0, 0)
        changed = tmp_path / "pool" / next(iter(expected_logs(campaign)))
        changed.write_text("changed")
        assert run(*asked).exit_code == 1
        assert run(*asked, "--overwrite").exit_code == 0
    assert logs_in(tmp_path / "pool") == expected_logs(campaign)
    assert run("check", str(tmp_path / "pool")).exit_code == 0


def test_a_campaign_that_ended_before_its_last_run_is_no_success(run: Run, tmp_path: Path) -> None:
    class Broken(Simulated):
        def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
            if number == 1:
                raise SettingError("the vehicle does not arm")
            return (yield from super().drive(campaign, number, halted))

    campaign = made_campaign(3)
    (tmp_path / "campaign.json").write_text(campaign.text)
    with vehicle_at(tmp_path / "vehicle", drives=Broken(MODEL, 500.0)) as vehicle:
        asked = ["collect", vehicle.url, "--token", TOKEN, "-o", str(tmp_path / "pool")]
        found = run(*asked, "--campaign", str(tmp_path / "campaign.json"))
        says = f"Error: campaign {campaign.id[:8]} ended after 1 of 3 runs: the vehicle does not arm\n"
        assert (found.exit_code, found.stderr) == (1, says) and "1 of 3" in found.stdout
        assert "1 logs fetched" in found.stdout and len(logs_in(tmp_path / "pool")) == 1
        assert run(*asked).exit_code == 0  # what is there was asked for, and is here


def test_serve_tells_what_becomes_of_campaigns(model: str, tmp_path: Path) -> None:
    """In its own terminal; with an address of IPv6, where there are any."""
    host = "[::1]"
    try:
        with socket.create_server(("::1", 0), family=socket.AF_INET6) as free:
            port = free.getsockname()[1]
    except OSError:
        host = "127.0.0.1"
        with socket.create_server((host, 0)) as free:
            port = free.getsockname()[1]
    whole, large = made_campaign(2), replace(made_campaign(2), battery=replace(BATTERY, at_moment=9.0))
    large = replace(large, runs=(replace(large.runs[0], commands=((5.0, 1.0),)),))
    command = [*ALONE, "serve", str(tmp_path / "v"), "--vehicle", "simulated", "--model", model, "--speed", "1000"]
    with subprocess.Popen(
        [*command, "--address", f"{host}:{port}"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout is not None and server.stderr is not None
        url = server.stdout.readline().strip()
        client = Client.of(url, server.stdout.readline().removeprefix("token: ").strip())
        assert url == client.url == f"http://{host}:{port}"
        with pytest.raises(SettingError, match=r"the vehicle refuses: run 01_step_.* asks for a moment of 5 nu"):
            Collector(client, tmp_path / "pool", 60.0).collect(large, stop=False)
        Collector(client, tmp_path / "pool", 60.0).collect(whole, stop=False)
        said = [server.stderr.readline() for _ in range(3)]
        server.send_signal(signal.SIGTERM)
        assert server.wait(timeout=60) == 130
    assert said[0].startswith(f"campaign {large.id[:8]} is refused: run 01_step_+0.400 asks for a moment of 5 nu, and")
    assert said[1:] == [f"campaign {whole.id[:8]} is accepted\n", f"campaign {whole.id[:8]} ended after 2 of 2 runs\n"]


@pytest.mark.parametrize("address", ["::1:8722", "[::1]", "8722", "a:b", ":1"])
def test_an_address_to_listen_on_that_is_none(run: Run, model: str, tmp_path: Path, address: str) -> None:
    found = run("serve", str(tmp_path / "v"), "--vehicle", "simulated", "--model", model, "--address", address)
    assert found.exit_code == 1 and "expected HOST:PORT, such as 0.0.0.0:8722 or [::1]:8722" in found.stderr


def test_serve_prints_its_address_and_token_and_ends_in_order(model: str, tmp_path: Path) -> None:
    port = free_port(os.getpid())
    command = [*ALONE, "serve", str(tmp_path / "v"), "--vehicle", "simulated", "--model", model]
    asked = [*command, "--address", f"127.0.0.1:{port}"]
    with subprocess.Popen(asked, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None and server.stderr is not None
        assert server.stdout.readline() == f"http://127.0.0.1:{port}\n"
        said = server.stdout.readline().removeprefix("token: ").strip()
        token = tmp_path / "v" / "token"
        assert said == token.read_text().strip() and len(said) >= 32 and token.stat().st_mode & 0o077 == 0
        second = subprocess.run(asked, capture_output=True, text=True, check=False)
        assert second.returncode == 1 and "is served already; end that `automarine serve`" in second.stderr
        server.send_signal(signal.SIGTERM)
        assert server.wait(timeout=600) == 130
        assert server.stderr.read() == "Interrupted; nothing was left half written.\n"
    assert not (tmp_path / "v" / "lease").exists()
