"""A vehicle's disk that is full, or fails: nothing is armed that cannot be logged, and a stop is in force at once."""

import contextlib
import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_ardusub import FakeSub, Tank, campaign_of
from link_requests import collected, logs_in
from made_link import MODEL, TOKEN, expected_logs, handed_over, made_campaign, vehicle_at

from automarine_cli.errors import OutputError, SettingError
from automarine_cli.link import store as store_module
from automarine_cli.link.document import CampaignState, LinkCampaign
from automarine_cli.link.player import Player
from automarine_cli.link.server import LinkServer
from automarine_cli.link.store import MAX_DEATHS, Store
from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub
from automarine_cli.link.vehicles.base import Vehicle
from automarine_cli.link.vehicles.simulated import Simulated

CAMPAIGN = campaign_of(0.5, -0.5, seconds=4.0)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a disk of 256 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    if sys.platform != "linux" or not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("a small file system can be mounted by root on Linux only")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def fill(folder: Path) -> None:
    with contextlib.suppress(OSError), (folder / "camera").open("wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))


def play(store: Store, vehicle: Vehicle) -> CampaignState:
    """Play until the first campaign is over; what became of it."""
    Player(store, vehicle, 1e9, lambda: bool(store.accepted()) or store.is_playing()).play()
    return store.state().campaigns[0]


def sub_of(vehicle: FakeSub) -> ArduSub:
    return ArduSub(vehicle.address, clock=Tank(vehicle))


def arms(vehicle: FakeSub) -> int:
    return sum(one.name == "COMMAND_LONG" and one.message.command == 400 and one.message.param1 == 1
               for one in vehicle.packets)  # fmt: skip


def test_a_full_disk_arms_nothing_and_can_be_stopped(small_disk: Path) -> None:
    store, vehicle = handed_over(small_disk, CAMPAIGN), FakeSub()
    other = campaign_of(0.4)
    store.accept(other.text.encode(), other.id)
    fill(small_disk)
    store.stop("somebody had a reason", [other.id])  # in force, and its reason kept
    play(store, sub_of(vehicle))
    assert arms(vehicle) == 0 and not vehicle.sticks() and list(store.runs.iterdir()) == []
    first, second = Store(small_disk).state().campaigns  # as a process that begins now reads it
    assert (first.over, first.played) == (True, 0) and first.why_stopped is not None
    assert "cannot be logged (No space left on device); make room on the vehicle's disk" in first.why_stopped
    assert (second.over, second.why_stopped) == (True, "somebody had a reason")


def test_a_disk_without_room_for_a_campaign_is_the_vehicle_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with vehicle_at(tmp_path / "vehicle") as vehicle:
        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(SettingError, match=r"the vehicle's disk does not take the campaign .No space left on"):
            collected(vehicle.url, tmp_path / "pool", CAMPAIGN)
        assert list(vehicle.store.campaigns.iterdir()) == []


def test_a_run_that_has_its_room_is_logged_on_a_full_disk(small_disk: Path) -> None:
    campaign = made_campaign(1)
    store = handed_over(small_disk, campaign)

    class Filled(Simulated):
        def drive(self, *given: object) -> Iterator[str]:  # type: ignore[override]
            fill(small_disk)
            return super().drive(*given)  # type: ignore[arg-type]

    play(store, Filled(MODEL, 1e9))
    assert logs_in(store.runs) == expected_logs(campaign)


def test_a_log_without_room_arms_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same where nobody can mount a disk: the run needs more room than any disk here has, and takes none of it."""
    store, vehicle, taken = handed_over(tmp_path, CAMPAIGN), FakeSub(), list[int]()

    def close(number: int) -> None:
        taken.append(os.fstat(number).st_blocks)
        os_close(number)

    os_close = os.close
    monkeypatch.setattr(store_module.os, "close", close)
    monkeypatch.setattr(LinkCampaign, "room", lambda *_: 1 << 43)
    state = play(store, sub_of(vehicle))
    assert arms(vehicle) == 0 and state.over and " cannot be logged (" in str(state.why_stopped)
    assert list(store.runs.iterdir()) == [] and taken and max(taken) * 512 < 1_000_000


def test_a_log_that_breaks_off_ends_the_run_and_the_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neutral, disarmed, over: also where the disk fails in the middle of a run."""
    store, vehicle, written = handed_over(tmp_path, CAMPAIGN), FakeSub(), list[bytes]()

    def write(number: int, content: bytes) -> int:
        if len(written) == 60:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        written.append(content)
        return os_write(number, content)

    os_write = os.write
    monkeypatch.setattr(store_module.os, "write", write)
    state = play(store, sub_of(vehicle))
    assert state.over and (state.played, arms(vehicle)) == (1, 1) and not vehicle.armed
    assert "cannot be logged (Input/output error)" in str(state.why_stopped)
    ((name, content),) = logs_in(store.runs).items()
    assert name.endswith("_stopped.csv") and content == b"".join(written)
    assert not vehicle.sticks()[-1].message.r


def test_a_player_that_dies_before_its_log_begins_is_started_a_few_times_only(tmp_path: Path) -> None:
    """Each start arms the vehicle and turns it: a supply that breaks down at that would have it armed for ever."""
    store = handed_over(tmp_path, CAMPAIGN)
    name = CAMPAIGN.log_name(CAMPAIGN.runs[0])
    for _ in range(MAX_DEATHS):
        os.close(store.begin(name, 1000))  # and then there is silence
        store.close_leftovers()
    vehicle = FakeSub()
    state = play(store, sub_of(vehicle))
    assert arms(vehicle) == 0 and state.over and state.played == 0
    assert f"ended {MAX_DEATHS} times before {name} had a line in its log; look at" in str(state.why_stopped)


def test_neither_a_stop_nor_a_hash_needs_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room(*_: object, **__: object) -> None:
        raise OutputError("no space left on device")

    campaign = made_campaign(2)
    store, stopped = handed_over(tmp_path, campaign), handed_over(tmp_path / "stopped", CAMPAIGN)
    with monkeypatch.context() as patch:
        patch.setattr(store_module, "write_whole", no_room)
        stopped.stop()
        assert stopped.accepted() == [] and stopped.state().campaigns[0].why_stopped == "asked to stop"
        play(store, Simulated(MODEL, 1e9))
    assert logs_in(store.runs) == expected_logs(campaign)
    whole = handed_over(tmp_path / "other", campaign)
    play(whole, Simulated(MODEL, 1e9))
    assert store.listing() == whole.listing()


@pytest.mark.skipif(sys.platform != "linux", reason="needs fallocate")
def test_room_is_kept_out_of_sight_and_given_back(tmp_path: Path) -> None:
    store = handed_over(tmp_path, CAMPAIGN)
    name = CAMPAIGN.log_name(CAMPAIGN.runs[0])
    number = store.begin(name, 1_000_000)
    store.write(number, name, "time_s\n")
    held = os.fstat(number)
    os.close(number)
    assert held.st_size == 7 and store.part(name).read_bytes() == b"time_s\n"
    store.close(name, "")
    assert held.st_blocks * 512 >= 1_000_000 > 65536 > (store.runs / f"{name}.csv").stat().st_blocks * 512


def test_a_disk_that_keeps_no_stop_ends_the_lease(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that takes nothing more, not even a new name: the player is left without its server's lease."""
    store = handed_over(tmp_path, CAMPAIGN)
    store.lease.write_text("word")

    def refused(*_: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    with LinkServer(("127.0.0.1", 0), store, Simulated(MODEL), TOKEN) as server:
        monkeypatch.setattr(Path, "replace", refused)
        assert server.stop() and not store.lease.exists()
        _, trouble = server.state().troubles  # the first says that the campaign goes on
        assert "nothing is driven until `automarine serve` is started again" in trouble and "Read-only" in trouble
        with pytest.raises(SettingError, match="nothing is driven until"):
            server.accept(b"", "0" * 64)
