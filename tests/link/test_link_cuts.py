"""A link that is cut: no byte wrong, no run lost or played twice, nothing commanded after a stop. Who and what a
vehicle and its surface need not trust: tokens, odd files, strangers, spoilt and senseless answers."""

import contextlib
import csv
import hashlib
import http.server
import io
import json
import os
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import pytest
from click.testing import Result
from link_requests import ask, collected, logs_in, put, until
from made_link import (
    BATTERY,
    MODEL,
    MODEL_FILE,
    TOKEN,
    CuttingProxy,
    expected_logs,
    handed_over,
    made_campaign,
    vehicle_at,
)

from automarine_cli.errors import SettingError
from automarine_cli.link import collector as collector_module
from automarine_cli.link import server
from automarine_cli.link import server as server_module
from automarine_cli.link.collector import Client, Collector, _Answer
from automarine_cli.link.document import CampaignState, Listing, Log, State
from automarine_cli.link.player import Player
from automarine_cli.link.server import LinkServer, token_of
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


DAMAGES: dict[str, Callable[[Path], object] | None] = {
    "a bit": lambda log: log.write_bytes(spoil(log.read_bytes(), 100)), "cut": lambda log: os.truncate(log, 90),
    "empty": lambda log: os.truncate(log, 0), "unreadable": None,
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_log_keeps_no_other_from_being_fetched(
    damage: Callable[[Path], object] | None, tmp_path: Path, run: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
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


# Who and what a vehicle and its surface need not trust: tokens, odd files, strangers, spoilt and senseless answers.


Run = Callable[..., Result]


# tokens


@pytest.mark.parametrize("content", ["", "\n", "tök", "a\tb"])
def test_a_file_without_a_token_opens_nothing(content: str, tmp_path: Path) -> None:
    (tmp_path / "token").write_text(content)
    (tmp_path / "token").chmod(0o600)
    with pytest.raises(SettingError, match="token holds no token; delete it, and a new one is made"):
        token_of(tmp_path)


def test_a_token_that_others_may_read_is_refused_and_a_server_without_one_lets_nobody_in(tmp_path: Path) -> None:
    token = token_of(tmp_path)
    assert len(token) >= 32 and token_of(tmp_path) == token
    (tmp_path / "token").chmod(0o640)
    with pytest.raises(SettingError, match=r"others may read or change .*token \(mode 640\); delete it, .*`chmod 600`"):
        token_of(tmp_path)
    (tmp_path / "token").unlink()
    (tmp_path / "secret").write_text("elsewhere")
    (tmp_path / "token").symlink_to("secret")
    with pytest.raises(SettingError, match="is a link or a folder; delete it"):
        token_of(tmp_path)
    with vehicle_at(tmp_path / "vehicle") as vehicle:
        vehicle.server.token = ""
        assert [ask(vehicle.port, "GET", "/state", authorization=one)[0] for one in ("Bearer ", "Bearer")] == [401, 401]


# odd files and links in the vehicle's folder


def test_odd_files_are_passed_over_and_told(run: Run, tmp_path: Path) -> None:
    campaign, outside = made_campaign(2), tmp_path / "outside.csv"
    outside.write_text("secret\nhalf a line")
    store = Store(tmp_path / "vehicle")
    store.prepare()
    for name in ("runs/a.csv", "runs/b.part", "campaigns/0002_folder.json"):
        (store.folder / name).mkdir()
    for name in ("runs/link.csv", "runs/link.part", "campaigns/0003_link.json"):
        (store.folder / name).symlink_to(outside)
    (store.campaigns / "0001_x.json").write_text("{")
    (store.runs / "own.csv").write_text("time_s\n")
    (store.runs / "own.csv.sha256").write_bytes(b"\xff")
    with vehicle_at(store.folder) as vehicle:
        state = collected(vehicle.url, tmp_path / "pool", campaign)
        assert [ask(vehicle.port, "GET", f"/runs/{name}.csv")[0] for name in ("link", "a")] == [404, 404]
        printed = run("collect", vehicle.url, "--token", TOKEN, "-o", str(tmp_path / "pool")).stdout
    assert logs_in(tmp_path / "pool") == expected_logs(campaign) | {"own.csv": b"time_s\n"}
    assert outside.read_text() == "secret\nhalf a line"
    assert "On the vehicle campaigns/0001_x.json is passed over (" in printed
    assert sorted(trouble.partition(" ")[0] for trouble in state.troubles) == [
        "campaigns/0001_x.json", "campaigns/0002_folder.json", "campaigns/0003_link.json",
        "runs/a.csv", "runs/b.part", "runs/link.csv", "runs/link.part",
    ]  # fmt: skip


def test_a_campaign_that_is_not_what_was_accepted_is_not_driven(tmp_path: Path) -> None:
    campaign = made_campaign(2)
    store = handed_over(tmp_path, campaign)
    (document,) = store.campaigns.glob("*.json")
    document.write_text(replace(campaign, rest_s=2.0).text)
    assert store.accepted() == [] and "not those that it was accepted with" in store.state().troubles[0]


# stops and moments


def test_a_late_copy_of_a_stop_leaves_the_next_campaign_alone(tmp_path: Path) -> None:
    first, second = made_campaign(2, seconds=1200.0), made_campaign(2)
    with vehicle_at(tmp_path, speed=100.0) as vehicle:
        put(vehicle.port, first)
        assert ask(vehicle.port, "POST", f"/stop/{first.id}")[0] == 200
        put(vehicle.port, second)
        assert ask(vehicle.port, "POST", f"/stop/{first.id}")[0] == 200
        until(lambda: vehicle.store.accepted() == [])
        assert [one.why_stopped for one in vehicle.store.state().campaigns] == ["asked to stop", None]
        third, fourth = made_campaign(3, seconds=599.0), made_campaign(3, seconds=598.0)
        for one in (third, fourth):
            put(vehicle.port, one)
        assert ask(vehicle.port, "POST", f"/stop/{third.id},{fourth.id}") == (200, b'{"stopped": true, "quiet": true}')
        assert vehicle.store.accepted() == []
        assert [ask(vehicle.port, "POST", path)[0] for path in ("/stop/", "/stop/x", "/stopped")] == [404] * 3


def test_the_largest_moment_is_the_vehicle_s(tmp_path: Path) -> None:
    campaign = made_campaign(2)
    runs = tuple(replace(one, commands=((1e6, 1.0),)) for one in campaign.runs)
    campaign = replace(campaign, battery=replace(BATTERY, at_moment=1e6, charge_Ah=1e3), runs=runs)
    with vehicle_at(tmp_path) as vehicle:
        status, content = ask(vehicle.port, "PUT", f"/campaigns/{campaign.id}", campaign.text.encode())
        assert status == 422 and b"asks for a moment of 1e+06 nu, and the whole output gives 1; plan with" in content
    file = tmp_path / "yaw_model.json"
    file.write_text(json.dumps(MODEL_FILE | {"moment_unit": "N m"}))
    with pytest.raises(SettingError, match=r"does not say how large moments in N m may be; give --full"):
        Simulated.of(file, 1.0)
    assert Simulated.of(file, 1.0, 12.0).full == 12.0
    for unit, limits, full in (("N m", [-3.0, 2.0], 3.0), ("nu", [-0.3, 0.2], 1.0)):
        file.write_text(json.dumps(MODEL_FILE | {"moment_unit": unit, "valid_range": {"moment": limits}}))
        assert Simulated.of(file, 1.0).full == full


# strangers


def test_silent_strangers_give_way(tmp_path: Path) -> None:
    """Many connections that say nothing: who has the token is heard, and the first of the others are hung up on."""
    with vehicle_at(tmp_path) as vehicle, contextlib.ExitStack() as stack:
        silent = [
            stack.enter_context(socket.create_connection(("127.0.0.1", vehicle.port), timeout=60.0))
            for _ in range(2 * server_module.MAX_STRANGERS)
        ]
        assert ask(vehicle.port, "GET", "/state")[0] == 200
        assert [one.recv(1) for one in silent[: server_module.MAX_STRANGERS]] == [b""] * server_module.MAX_STRANGERS


def test_who_trickles_is_hung_up_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "HEADER_S", 0.2)
    with vehicle_at(tmp_path) as vehicle:
        with socket.create_connection(("127.0.0.1", vehicle.port)) as trickle, pytest.raises(OSError):
            trickle.sendall(b"GET /state HTTP/1.1\r\n")
            while True:  # ends when the other side hangs up
                trickle.sendall(b"X")
                time.sleep(0.02)
        assert ask(vehicle.port, "GET", "/state")[0] == 200


# answers


@dataclass(frozen=True)
class SpoiltLink(Client):
    """A byte is spoilt on the way: of the first answer to each kind of request, `at` this place in it; with `request`
    that of what is asked."""

    at: int = 0
    request: bool = False
    spoilt: set[str] = field(default_factory=set)

    def _ask(self, method: str, path: str, body: bytes | None, headers: dict[str, str]) -> _Answer:
        kind = "log" if path.startswith("/runs/") else path[:6]
        if kind in self.spoilt:
            return super()._ask(method, path, body, headers)
        self.spoilt.add(kind)
        if self.request and body is not None:
            return super()._ask(method, path, spoil(body, self.at), headers)
        if self.request:
            return replace(self, token=spoil(self.token.encode(), self.at).decode())._ask_once(method, path, headers)
        answer = super()._ask(method, path, body, headers)
        return answer._replace(content=spoil(answer.content, self.at))

    def _ask_once(self, method: str, path: str, headers: dict[str, str]) -> _Answer:
        return super()._ask(method, path, None, headers)


def spoil(content: bytes, at: int) -> bytes:
    at %= len(content)
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


def test_a_spoilt_byte_is_never_believed(tmp_path: Path) -> None:
    """Every 13th byte of the listing, and as many of state, campaign and token: names, sizes, hashes, keys."""
    campaign = made_campaign(1, seconds=0.5)
    with vehicle_at(tmp_path / "vehicle", 1e4) as vehicle:
        collected(vehicle.url, tmp_path / "pool", campaign)
        _, listing = ask(vehicle.port, "GET", "/runs")
        for at in range(0, len(listing), 13):
            for request in (False, True):
                link = SpoiltLink("127.0.0.1", vehicle.port, TOKEN, at=at, request=request)
                folder = tmp_path / f"{at}{request}"
                Collector(link, folder, 20.0, poll_s=0.001).collect(campaign, stop=False)
                assert logs_in(folder) == expected_logs(campaign) and len(link.spoilt) == 4


@contextlib.contextmanager
def answering(**answers: object) -> Iterator[str]:
    """Somebody who answers state, runs and logs as given, bytes as they are and all else as JSON, with a right hash."""

    class Answers(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            name = "log" if self.path.startswith("/runs/") else self.path[1:]
            answer = answers[name]
            content = answer if isinstance(answer, bytes) else json.dumps(answer).encode()
            self.send_response(206 if name == "log" else 200)
            self.send_header("ETag", f'"{hashlib.sha256(content).hexdigest()}"')
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            """Nothing."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Answers) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}).start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}"
        finally:
            server.shutdown()


ESCAPE = "\x1b]0;owned\x07"
OVER = CampaignState("0" * 64, 2, 1, 0, over=True, battery_left_Ah=1.0, why_stopped=f"no{ESCAPE}pe")
STATE = asdict(State("automarine/link-state/1", (OVER,), None, (f"runs/{ESCAPE}",)))
EMPTY = asdict(Listing("automarine/link-runs/1", ()))
ONE = asdict(Listing("automarine/link-runs/1", (Log("a.csv", 10, closed=True, sha256="0" * 64),)))


@pytest.mark.parametrize(
    ("answers", "says"),
    [
        ({"state": {}}, 'the vehicle\'s state: key "schema" is missing'),
        ({"state": []}, "the vehicle's answer: found a list of 0, expected an object"),
        ({"state": b"[" * 100_000}, "not valid JSON: nested too deep"),
        ({"state": STATE | {"campaigns": [{}]}}, 'campaigns[0]: key "id" is missing'),
        ({"state": STATE | {"campaigns": [asdict(OVER) | {"id": ESCAPE}]}}, "expected the SHA-256 of a campaign"),
        ({"state": STATE, "runs": {}}, 'the vehicle\'s list of logs: key "schema" is missing'),
        ({"state": STATE, "runs": EMPTY | {"runs": 3}}, "runs: found 3, expected a list"),
        ({"state": STATE, "runs": json.dumps(ONE).replace("a.csv", "../a.csv").encode()}, "a log cannot be called"),
        ({"state": STATE, "runs": json.dumps(ONE).replace("0000", "zz").encode()}, "expected 64 hex digits"),
        ({"state": STATE, "runs": json.dumps(ONE).replace("10", "1e99").encode()}, "runs[0].size: found 1e+99"),
        ({"state": STATE, "runs": ONE, "log": b""}, "lists a.csv and does not hand it out (status 206)"),
        ({"state": STATE, "runs": ONE, "log": b"0123456789"}, "a.csv came 3 times with another SHA-256"),
    ],
)
def test_an_answer_without_sense_is_a_sentence(answers: dict[str, object], says: str, tmp_path: Path) -> None:
    with answering(**answers) as url:
        collector = Collector(Client.of(url, TOKEN), tmp_path, None, poll_s=0.001)
        try:
            collector.collect(None, stop=False)
            (refused,) = collector.damaged
        except SettingError as problem:
            refused = str(problem)
    assert says in refused and "\x1b" not in refused
    assert logs_in(tmp_path) == {}


@pytest.mark.parametrize("greeting", [b"SSH-2.0-OpenSSH\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}"])
def test_another_server_is_told_from_a_link_that_is_cut(greeting: bytes, tmp_path: Path) -> None:
    def greet() -> None:
        with contextlib.suppress(OSError):
            while True:
                with other.accept()[0] as one:
                    one.recv(4096)
                    one.sendall(greeting)

    with socket.create_server(("127.0.0.1", 0)) as other:
        threading.Thread(target=greet, daemon=True).start()
        client = Client("127.0.0.1", other.getsockname()[1], TOKEN)
        with pytest.raises(SettingError, match=r"does not speak HTTP|does not answer as a vehicle of ours"):
            Collector(client, tmp_path, None, poll_s=0.001).collect(None, stop=False)
        other.shutdown(socket.SHUT_RDWR)


def test_what_a_vehicle_says_is_shown_without_its_control_characters(run: Run, tmp_path: Path) -> None:
    with answering(state=STATE, runs=EMPTY) as url:
        asked = ["collect", url, "--token", TOKEN, "-o", str(tmp_path)]
        table, data = run(*asked), run(*asked, "--json")
    assert not {"\x1b", "\x07"} & set(table.output + data.output)
    assert "no\\x1b]0;owned\\x07pe" in table.stdout and "On the vehicle runs/\\x1b]0;owned\\x07." in table.stdout


def test_a_campaign_that_the_vehicle_lost_is_not_waited_for(tmp_path: Path) -> None:
    campaign = made_campaign(2, seconds=100.0)
    with vehicle_at(tmp_path / "vehicle", 1.0) as vehicle:
        put(vehicle.port, campaign)
        (document,) = vehicle.store.campaigns.glob("*.json")
        document.write_text(document.read_text().replace("wait_s", "wait_S"))
        with pytest.raises(
            SettingError, match=f"does not know campaign {campaign.id[:8]} any more; send it again; campaigns/0001_"
        ):
            collected(vehicle.url, tmp_path / "pool", campaign)
        vehicle.alive.clear()


def test_ipv6(tmp_path: Path) -> None:
    try:
        server = LinkServer(("::1", 0), Store(tmp_path), Simulated(MODEL), TOKEN)
    except OSError:
        pytest.skip("no IPv6 here")
    url = f"http://[::1]:{server.server_address[1]}"
    server.store.prepare()
    with server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}).start()
        try:
            assert Client.of(url, TOKEN).url == url and Client.of(url, TOKEN).state().campaigns == ()
        finally:
            server.shutdown()
