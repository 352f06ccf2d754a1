"""The rule of the player, clause by clause: the vehicle moves only for a run that was accepted and carries no durable
mark of being finished, stopped or interrupted, while its campaign's document is intact on the disk, nobody has said
stop, and every call to the actuator has returned (that clause on a CAN bus is in test_link_can.py)."""

import json
import os
import shutil
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path

import pytest
from link_requests import ask, logs_in, put, until
from made_link import MODEL, TOKEN, handed_over, made_campaign, vehicle_at

from automarine_cli.link import player, server
from automarine_cli.link.collector import Client, Collector
from automarine_cli.link.document import CampaignState, LinkCampaign, Listing, State
from automarine_cli.link.player import Player
from automarine_cli.link.server import LinkServer
from automarine_cli.link.store import LONGEST_WHY, Store
from automarine_cli.link.vehicles.base import Halted
from automarine_cli.link.vehicles.simulated import Simulated

pytestmark = pytest.mark.usefixtures("quick")
CAMPAIGN = made_campaign(3)
LONG = made_campaign(2, seconds=600.0)
Act = Callable[[Store], object]


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(player, "TICK_S", 0.005)
    monkeypatch.setattr(server, "QUIET_S", 2.0)  # so long waits who stops a vehicle without a folder


def driven(store: Store, vehicle: Simulated | None = None) -> list[str]:
    """The logs that a new player adds until nothing is due."""
    before, looks = {*logs_in(store.runs)}, iter(range(30))
    Player(Store(store.folder), vehicle or Simulated(MODEL, 1e9), 1e9, lambda: _is_due(store) or any(looks)).play()
    return sorted({*logs_in(store.runs)} - before)


def _is_due(store: Store) -> bool:
    return any(store.next_run(campaign) is not None for campaign in store.accepted())


def document(store: Store) -> Path:
    (file,) = store.campaigns.glob("*.json")
    return file


def record(store: Store) -> Path:
    (file,) = (*store.campaigns.glob("*.ready"), *store.campaigns.glob("*.stopped"))
    return file


def marks(store: Store) -> str:
    return record(store).read_text()[LONGEST_WHY:]


# accepted


def test_a_document_that_was_only_put_there_is_not_driven(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.prepare()
    (store.campaigns / f"0001_{CAMPAIGN.id}.json").write_text(CAMPAIGN.text)
    assert driven(store) == [] and "its record is missing or damaged" in store.state().troubles[0]


def test_a_campaign_whose_document_was_deleted_is_not_new_when_it_is_sent_again(tmp_path: Path) -> None:
    store = handed_over(tmp_path, CAMPAIGN)
    assert len(driven(store)) == 3
    document(store).unlink()
    shutil.rmtree(store.runs)
    assert handed_over(tmp_path, CAMPAIGN).state().campaigns[0].played == 3 and driven(store) == []


# no durable mark


def interrupt(store: Store) -> None:
    """The power is cut in the first run, after its first line."""
    name = CAMPAIGN.log_name(CAMPAIGN.runs[0])
    number = store.begin(name, 1000)
    store.write(number, name, "time_s\n")
    os.close(number)


@pytest.mark.parametrize(("act", "left", "end"), [(driven, 0, "www"), (Store.stop, 0, "000"), (interrupt, 2, "dww")])
def test_runs_that_ended_are_not_driven_again_without_their_logs(act: Act, left: int, end: str, tmp_path: Path) -> None:
    store = handed_over(tmp_path, CAMPAIGN)
    act(store)
    shutil.rmtree(store.runs)
    store.prepare()
    again = Store(tmp_path)
    names = [f"{CAMPAIGN.log_name(run)}.csv" for run in CAMPAIGN.runs[len(CAMPAIGN.runs) - left :]]
    assert driven(again) == names and marks(store) == end and driven(again) == []
    assert again.state().campaigns[0].over


def test_a_run_is_marked_before_its_log_gets_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(5, os.strerror(5))

    store = handed_over(tmp_path, CAMPAIGN)
    number = store.begin(name := CAMPAIGN.log_name(CAMPAIGN.runs[0]), 1000)
    store.write(number, name, "time_s\n")
    os.close(number)
    assert marks(store) == "d00"
    with monkeypatch.context() as patch, pytest.raises(OSError, match="Input/output"):
        patch.setattr(Path, "replace", refuse)
        store.close(name, "")
    assert marks(store) == "w00" and logs_in(store.runs) == {}


def test_what_goes_on_without_being_sent_is_told(tmp_path: Path) -> None:
    store = handed_over(tmp_path, CAMPAIGN)
    interrupt(store)
    with LinkServer(("127.0.0.1", 0), Store(tmp_path), Simulated(MODEL), TOKEN) as server:
        (says,) = server.state().troubles
    assert says.endswith("was not over when serve started: it goes on with the last 2 of its 3 runs")
    driven(store)
    assert Store(tmp_path).resumed() == ()


# an intact document, and a stop whatever the disk says


def spoil(store: Store) -> None:
    document(store).write_bytes(document(store).read_bytes().replace(b"wait_s", b"wait_S", 1))


def lose(folder: Path) -> None:
    """Move a folder away at one stroke: deleted file by file, a new file may come in between."""
    folder.rename(folder.parent.with_name(f"{folder.parent.name} {folder.name}"))


FAULTS: dict[str, Act] = {
    "document damaged": spoil,
    "document deleted": lambda store: document(store).unlink(),
    "document cut": lambda store: os.truncate(document(store), 100),
    "record deleted": lambda store: record(store).unlink(),
    "record damaged": lambda store: record(store).write_text("x"),
    "campaigns deleted": lambda store: lose(store.campaigns),
    "runs deleted": lambda store: lose(store.runs),
}


@pytest.mark.parametrize("says_stop", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_campaign_that_is_damaged_while_it_plays_is_over(
    fault: str, says_stop: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a stop, and without one; what is asked is answered, and nothing is driven afterwards."""
    with vehicle_at(tmp_path, 20.0) as vehicle:
        put(vehicle.port, LONG)
        part = vehicle.store.part(LONG.log_name(LONG.runs[0]))
        until(lambda: part.exists() and part.stat().st_size > 100)
        text = document(vehicle.store).read_text()
        if says_stop:
            stop = vehicle.server.stop
            strike = lambda *only: (FAULTS[fault](vehicle.store), stop(*only))[1]  # noqa: E731
            monkeypatch.setattr(vehicle.server, "stop", strike)
            status, answer = ask(vehicle.port, "POST", "/stop")
            assert status == 200 and json.loads(answer)["stopped"]
        else:
            FAULTS[fault](vehicle.store)
        until(lambda: not part.exists())
        status, answer = ask(vehicle.port, "GET", "/state")
        assert status == 200 and (says_stop or json.loads(answer)["troubles"])
        if vehicle.store.campaigns.is_dir():
            (vehicle.store.campaigns / f"0001_{LONG.id}.json").write_text(text)  # as it was accepted
        vehicle.store.prepare()
        assert [name for name in vehicle.store.runs.iterdir() if name.suffix == ".part"] == []
    assert driven(vehicle.store) == []


@pytest.mark.parametrize(("playing", "over", "expected"), [
    (None, True, []), (None, False, [[LONG.id]]), ("0" * 8 + "_x", True, [[]]), ("0" * 8 + "_x", False, [[]]),
    (LONG.log_name(LONG.runs[0]), False, [[LONG.id]]),
])  # fmt: skip
def test_a_stop_goes_to_what_plays(playing: str | None, over: bool, expected: list[list[str]], tmp_path: Path) -> None:
    """To all, where the state lists no campaign that it could be."""
    stops = list[list[str]]()

    class Odd(Client):
        def state(self) -> State:
            return State("automarine/link-state/1", (CampaignState(LONG.id, 2, 1, 0, over, 1.0),), playing)

        def listing(self) -> Listing:
            return Listing("automarine/link-runs/1", ())

        def stop(self, ids: Sequence[str]) -> bool:
            stops.append([*ids])
            return True

    Collector(Odd("127.0.0.1", 9, TOKEN), tmp_path).collect(None, stop=True)
    assert stops == expected


# nobody has said stop


def test_a_stop_waits_for_no_upload_and_holds_for_those_that_wait(tmp_path: Path) -> None:
    looks, may_end = threading.Event(), threading.Event()

    class Thorough(Simulated):
        def refuse(self, campaign: LinkCampaign) -> None:
            looks.set()
            assert may_end.wait(60.0)

    with vehicle_at(tmp_path, drives=Thorough(MODEL, 1e9)) as vehicle:
        arrived, accept = list[str](), vehicle.server.accept
        vehicle.server.accept = lambda content, name: (arrived.append(name), accept(content, name))[1]  # type: ignore[method-assign]
        uploads = [threading.Thread(target=put, args=(vehicle.port, made_campaign(2 + i))) for i in range(3)]
        for upload in uploads:
            upload.start()
        assert looks.wait(60.0)
        until(lambda: len(arrived) == 3)
        assert json.loads(ask(vehicle.port, "POST", "/stop")[1]) == {"stopped": True, "quiet": True}
        may_end.set()
        for upload in uploads:
            upload.join()
        assert [one.why_stopped for one in vehicle.store.state().campaigns] == ["asked to stop"] * 3
    assert logs_in(vehicle.store.runs) == {}


# every call to the actuator has returned


def test_a_vehicle_that_fails_in_any_way_ends_its_campaign(tmp_path: Path) -> None:
    class Odd(Simulated):
        def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
            lines = super().drive(campaign, number, halted)
            yield from (next(lines) for _ in range(9))
            raise ZeroDivisionError("float division by zero")

    store = handed_over(tmp_path, CAMPAIGN)
    assert driven(store, Odd(MODEL, 1e9)) == [f"{CAMPAIGN.log_name(CAMPAIGN.runs[0])}_stopped.csv"]
    (state,) = store.state().campaigns
    assert state.over and state.why_stopped == "the vehicle failed (ZeroDivisionError: float division by zero)"
    assert driven(store) == []


def test_campaigns_that_go_while_they_are_read_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python before 3.13 raises where the folder is deleted after `glob` looked for it."""
    store = handed_over(tmp_path, CAMPAIGN)

    def gone(_path: Path, _pattern: str) -> Iterator[Path]:
        raise FileNotFoundError

    with monkeypatch.context() as patch:
        patch.setattr(Path, "glob", gone)
        assert store.state().campaigns == () and store.bar(CAMPAIGN, 0).startswith("its document")
    assert len(store.state().campaigns) == 1
