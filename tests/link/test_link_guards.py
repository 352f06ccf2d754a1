"""Who and what a vehicle and its surface need not trust: tokens, odd files, strangers, spoilt and senseless answers."""

import contextlib
import hashlib
import http.server
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import pytest
from click.testing import Result
from link_requests import ask, collected, logs_in, put, until
from made_link import BATTERY, MODEL, TOKEN, expected_logs, handed_over, made_campaign, vehicle_at

from automarine_cli.errors import SettingError
from automarine_cli.link import server as server_module
from automarine_cli.link.collector import Client, Collector, _Answer
from automarine_cli.link.document import CampaignState, Listing, Log, State
from automarine_cli.link.server import LinkServer, token_of
from automarine_cli.link.store import Store
from automarine_cli.link.vehicles.simulated import Simulated

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
    model = {
        "schema": "automarine/yaw-model/1", "moment_unit": "N m", "preferred": "3", "effects": [],
        "models": {"3": {"I_r": {"value": 1.0, "unit": "N m s²"}, "k_rr": {"value": 1.25, "unit": "N m s²"}}},
    }  # fmt: skip
    file = tmp_path / "yaw_model.json"
    file.write_text(json.dumps(model))
    with pytest.raises(SettingError, match=r"does not say how large moments in N m may be; give --full"):
        Simulated.of(file, 1.0)
    assert Simulated.of(file, 1.0, 12.0).full == 12.0
    for unit, limits, full in (("N m", [-3.0, 2.0], 3.0), ("nu", [-0.3, 0.2], 1.0)):
        file.write_text(json.dumps(model | {"moment_unit": unit, "valid_range": {"moment": limits}}))
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
