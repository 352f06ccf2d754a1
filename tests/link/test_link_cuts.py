"""A link that is cut: no byte wrong, no run lost or played twice, nothing commanded after a stop; who has no token."""

import csv
import hashlib
import io
import json
import os
import random
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from link_requests import ask, collected, logs_in, put, until
from made_link import MODEL, TOKEN, CuttingProxy, expected_logs, handed_over, made_campaign, vehicle_at

from automarine_cli.errors import SettingError
from automarine_cli.link import collector as collector_module
from automarine_cli.link import server
from automarine_cli.link.collector import Client, Collector
from automarine_cli.link.player import Player
from automarine_cli.link.store import Store
from automarine_cli.link.vehicles.simulated import Simulated


def test_what_comes_over_a_cut_link_is_what_was_sent(tmp_path: Path) -> None:
    campaign = made_campaign(5, seconds=30.0)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        proxy = CuttingProxy(vehicle.port, ("reset", "reset", "stall", "half-open", "slow", "none"), 2000, seed=1)
        with proxy.running() as url:
            client = Client.of(url, TOKEN)
            collector = Collector(Client(client.host, client.port, TOKEN, 0.2), tmp_path / "pool", 600.0, poll_s=0.02)
            (state,) = collector.collect(campaign, stop=False).campaigns
    assert proxy.cuts >= 5 and collector.cuts >= 5 and (state.played, state.over) == (5, True)
    logs = expected_logs(campaign)
    assert logs_in(tmp_path / "pool") == logs == logs_in(vehicle.store.runs)
    assert collector.ledger() == {name: hashlib.sha256(content).hexdigest() for name, content in logs.items()}


def test_a_campaign_put_many_times_is_played_once(tmp_path: Path) -> None:
    campaign = made_campaign(2)
    with vehicle_at(tmp_path) as vehicle:
        answers: list[int] = []
        many = [threading.Thread(target=lambda: answers.append(put(vehicle.port, campaign))) for _ in range(6)]
        for thread in many:
            thread.start()
        for thread in many:
            thread.join()
        assert sorted(answers) == [200] * 5 + [201]
        collected(vehicle.url, tmp_path / "pool", campaign)
    assert logs_in(vehicle.store.runs) == expected_logs(campaign)


def test_half_a_campaign_is_never_accepted(tmp_path: Path) -> None:
    campaign = made_campaign(2)
    content = campaign.text.encode()
    head = f"PUT /campaigns/{campaign.id} HTTP/1.1\r\nAuthorization: Bearer {TOKEN}\r\n"
    head += f"Content-Length: {len(content)}\r\n\r\n"
    with vehicle_at(tmp_path) as vehicle:
        with socket.create_connection(("127.0.0.1", vehicle.port)) as half:
            half.sendall(head.encode() + content[: len(content) // 2])
        time.sleep(0.1)
        assert vehicle.store.accepted() == [] and list(vehicle.store.campaigns.iterdir()) == []
        assert ask(vehicle.port, "PUT", f"/campaigns/{campaign.id}", content[:-5])[0] == 422


def test_nothing_is_commanded_after_a_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "QUIET_S", 60.0)
    campaign = made_campaign(3, seconds=600.0)
    with vehicle_at(tmp_path, speed=20.0) as vehicle:
        assert put(vehicle.port, campaign) == 201
        until(lambda: any(_is_driven(path) for path in vehicle.store.runs.glob("*.part")))
        status, content = ask(vehicle.port, "POST", "/stop")
        assert (status, json.loads(content)) == (200, {"stopped": True, "quiet": True})
        after = logs_in(vehicle.store.runs)
        assert list(after) == [f"{campaign.log_name(campaign.runs[0])}_stopped.csv"]
        time.sleep(0.3)  # six seconds of the vehicle's time
        assert logs_in(vehicle.store.runs) == after and not vehicle.store.is_playing()
        (state,) = vehicle.store.state().campaigns
        assert (state.over, state.why_stopped, state.played) == (True, "asked to stop", 1)
        assert put(vehicle.port, campaign) == 200  # known, and stopped for good
        time.sleep(0.2)
        assert logs_in(vehicle.store.runs) == after
    rows = list(csv.reader(next(iter(after.values())).decode().splitlines()))[2:]
    assert float(rows[-1][2]) == 0.0 and float(rows[-2][2]) != 0.0 and len(rows) < 6000  # neutral, then silence


def test_a_stop_between_two_runs_leaves_no_log(tmp_path: Path) -> None:
    class StoppedAtTheLastMoment(Store):
        def begin(self, name: str, room: int) -> int:
            self.stop()
            return super().begin(name, room)

    campaign = made_campaign(2)
    store = handed_over(tmp_path, campaign, StoppedAtTheLastMoment)
    Player(store, Simulated(MODEL, 1e9), 1e9, lambda: not store.bar(campaign, 0)).play()
    assert list(store.runs.iterdir()) == [] and store.state().campaigns[0].over


def test_a_run_that_never_began_is_played_after_a_power_cut(tmp_path: Path) -> None:
    campaign = made_campaign(1)
    store = handed_over(tmp_path, campaign)
    os.close(store.begin(campaign.log_name(campaign.runs[0]), 1000))
    Player(store, Simulated(MODEL, 1e9), 1e9, lambda: store.next_run(campaign) is not None).play()
    assert logs_in(store.runs) == expected_logs(campaign)


def _is_driven(log: Path) -> bool:
    """Whether the last moment in an open log is not zero."""
    last = log.read_text().rpartition("\n")[0].rpartition("\n")[2].rpartition(",")[2]
    return last.startswith(("0.", "-0."))


def test_a_stop_comes_before_the_campaign(tmp_path: Path) -> None:
    first, second = made_campaign(2, seconds=600.0), made_campaign(3)
    with vehicle_at(tmp_path / "vehicle", speed=50.0) as vehicle:
        put(vehicle.port, first)
        state = collected(vehicle.url, tmp_path / "pool", second, stop=True)
    assert [campaign.why_stopped for campaign in state.campaigns] == ["asked to stop", None]
    assert set(expected_logs(second)) <= set(logs_in(tmp_path / "pool"))


@pytest.mark.parametrize("token", ["", "wrong", TOKEN[:-1], f"{TOKEN}x"])
def test_nothing_is_told_to_who_has_no_token(token: str, tmp_path: Path) -> None:
    with vehicle_at(tmp_path) as vehicle:
        for method, path in (("GET", "/state"), ("GET", "/runs"), ("GET", "/runs/x.csv"), ("POST", "/stop")):
            assert ask(vehicle.port, method, path, authorization=f"Bearer {token}")[0] == 401
        path = f"/campaigns/{made_campaign().id}"
        assert ask(vehicle.port, "PUT", path, b"", authorization=f"Bearer {token}")[0] == 401
        assert vehicle.store.accepted() == []
        with pytest.raises(SettingError, match="refuses the token; give the one that serve printed with --token"):
            Collector(Client.of(vehicle.url, token), tmp_path / "pool", 5.0).collect(None, stop=False)


def test_ranges_and_names(tmp_path: Path) -> None:
    campaign = made_campaign(1)
    with vehicle_at(tmp_path) as vehicle:
        collected(vehicle.url, tmp_path / "pool", campaign)
        ((name, whole),) = expected_logs(campaign).items()
        place = f"/runs/{name.replace('+', '%2B')}"
        assert ask(vehicle.port, "GET", place) == (200, whole)
        assert ask(vehicle.port, "GET", place, range="bytes=10-19") == (206, whole[10:20])
        assert ask(vehicle.port, "GET", place, range=f"bytes={len(whole) - 3}-") == (206, whole[-3:])
        assert ask(vehicle.port, "GET", place, range=f"bytes={len(whole)}-")[0] == 416
        (vehicle.store.folder / "secret.csv").write_text("x")
        for path in ("/runs/../token", "/runs/..%2Ftoken", "/runs/../secret.csv", "/runs/", "/token", "/runs/none.csv"):
            assert ask(vehicle.port, "GET", path)[0] == 404
        assert ask(vehicle.port, "PUT", "/campaigns/../x", b"{}")[0] == 404
        assert ask(vehicle.port, "PUT", f"/campaigns/{'0' * 64}", b"{}")[0] == 422


def test_a_log_that_is_not_what_it_was_closed_as_is_refused(tmp_path: Path) -> None:
    campaign = made_campaign(1)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        collected(vehicle.url, tmp_path / "pool", campaign)
        (log,) = vehicle.store.runs.glob("*.csv")
        log.write_bytes(log.read_bytes().replace(b"0.5", b"0.6", 1)[:-1] + b"9")
        other = Collector(Client.of(vehicle.url, TOKEN), tmp_path / "other")
        other.collect(None, stop=False)
        assert "came 3 times with another SHA-256 than it was closed with, always the same" in other.damaged[0]
        assert logs_in(tmp_path / "other") == {} and logs_in(tmp_path / "pool") == expected_logs(campaign)
        (tmp_path / "pool" / log.name).write_text("changed")
        pool = Collector(Client.of(vehicle.url, TOKEN), tmp_path / "pool")
        pool.collect(None, stop=False)
        assert "was changed here since it was fetched" in pool.damaged[0]


def bit(log: Path) -> None:
    content = log.read_bytes()
    log.write_bytes(content[:100] + bytes([content[100] ^ 1]) + content[101:])


def cut(log: Path) -> None:
    os.truncate(log, 90)


def empty(log: Path) -> None:
    os.truncate(log, 0)


@pytest.mark.parametrize("damage", [bit, cut, empty, None])
def test_a_damaged_log_keeps_no_other_from_being_fetched(
    damage: Callable[[Path], None] | None, tmp_path: Path, run: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = made_campaign(3)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        collected(vehicle.url, tmp_path / "first", campaign)
        name, *others = expected_logs(campaign)
        if damage is not None:
            damage(vehicle.store.runs / name)
        else:
            opened = Store.open_log
            monkeypatch.setattr(Store, "open_log", lambda at, log: Unreadable() if log == name else opened(at, log))
            monkeypatch.setattr(collector_module.DamagedLogError, "tries", 3)
        fetched = run("collect", vehicle.url, "--token", TOKEN, "-o", str(tmp_path / "pool"))
    assert fetched.exit_code == 1 and sorted(logs_in(tmp_path / "pool")) == others
    assert f"Error: the vehicle lists {name}" in fetched.stderr or f"Error: {name} came 3 times" in fetched.stderr
    assert "2 logs fetched" in fetched.stdout and "vehicle's disk" in fetched.stderr


class Unreadable(io.BytesIO):
    """A file on a disk that fails."""

    def read(self, size: int | None = -1) -> bytes:
        raise OSError(5, os.strerror(5))


def test_a_link_that_spoils_logs_is_no_damaged_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = random.Random(1)

    class Spoiling(Client):
        def piece(self, name: str, first: int, size: int) -> bytes:
            content, at = super().piece(name, first, size), drawn.randrange(size)
            return content[:at] + bytes([content[at] ^ drawn.randrange(1, 256)]) + content[at + 1 :]

    campaign = made_campaign(1)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        collected(vehicle.url, tmp_path / "pool", campaign)
        other = Collector(Spoiling("127.0.0.1", vehicle.port, TOKEN), tmp_path / "other", poll_s=0.001)
        other.collect(None, stop=False)
    assert "came 20 times with another SHA-256" in other.damaged[0] and "the link spoils it" in other.damaged[0]


def test_two_collects_into_one_folder_fetch_every_log_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign, logs = made_campaign(4, seconds=20.0), expected_logs(made_campaign(4, seconds=20.0))
    monkeypatch.setattr(collector_module, "LOG_PIECE_BYTES", 500)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        collected(vehicle.url, tmp_path / "first", campaign)
        both = [Collector(Client.of(vehicle.url, TOKEN), tmp_path / "pool", poll_s=0.02) for _ in range(2)]
        threads = [threading.Thread(target=each.collect, args=(None, False)) for each in both]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert logs_in(tmp_path / "pool") == logs and both[0].damaged == both[1].damaged == []
    assert sum(each.bytes_in for each in both) == sum(map(len, logs.values()))


def test_no_contact_ends_after_the_time_given(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(SettingError, match=r"no contact with http://127.0.0.1:\d+ for 0.3 s .*; what came is kept"):
        Collector(Client.of(f"http://127.0.0.1:{port}", TOKEN), tmp_path / "pool", 0.3).collect(None, stop=False)


@pytest.mark.parametrize("url", ["ftp://a:1", "http://a", "http://a:x", "http://a:1/path"])
def test_an_address_that_is_none(url: str) -> None:
    with pytest.raises(SettingError, match=r"expected http://HOST:PORT"):
        Client.of(url, TOKEN)
