"""The process that plays campaigns: it drives while its server's lease is fresh, and never begins a run twice."""

import contextlib
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from automarine_cli.errors import AutomarineError, OutputError
from automarine_cli.link.document import INTERRUPTED, STOPPED, WHOLE, LinkCampaign
from automarine_cli.link.store import HeldElsewhereError, Store, held
from automarine_cli.link.vehicles.base import StuckError, Vehicle

LEASE_S = 3.0  # A server that has not been heard of for so long is gone
TICK_S = 0.1
GONE = "its server is gone"


class Lease:
    """Whether the server that started this player still touches the file that holds its word, by this process's own
    clock: a vehicle's wall clock may jump."""

    def __init__(self, store: Store, word: str) -> None:
        self._file, self._word = store.lease, word
        self._seen, self._when = -1, time.monotonic()

    def holds(self) -> bool:
        try:
            touched = self._file.stat().st_mtime_ns
            if self._file.read_text(encoding="ascii") != self._word:
                return False
        except OSError:
            return False
        now = time.monotonic()
        if touched != self._seen:
            self._seen, self._when = touched, now
        return now - self._when < LEASE_S


@dataclass(frozen=True)
class Player:
    """Plays what waits in a store on a vehicle, `speed` times as fast as the clock."""

    store: Store
    vehicle: Vehicle
    speed: float
    lives: Callable[[], bool]
    _ended: dict[str, str] = field(default_factory=dict)
    """Campaigns that ended here, whatever the disk says of them, and why."""

    def _bar(self, campaign: LinkCampaign, number: int) -> str:
        """Say what forbids the vehicle to move for a run, before every command; empty where it may.

        It moves only for a run that was accepted and has no mark of being finished, stopped or interrupted, while its
        campaign's document is intact, nobody has said stop, and every call to the actuator has returned."""
        barred = self._ended.get(campaign.id) or self.store.bar(campaign, number)
        return barred or ("" if self.lives() else GONE)

    def play(self) -> None:
        """Play until nobody lives for whom to play. Raises StuckError after a call to the actuator that hangs."""
        with contextlib.suppress(OSError):  # a log that stays open is never begun again
            self.store.close_leftovers()
        while self.lives():
            due = next(filter(None, map(self._due, self.store.accepted())), None)
            if due is not None and self._waited(*due):
                self._run(*due)
            else:
                time.sleep(TICK_S)

    def _due(self, campaign: LinkCampaign) -> tuple[LinkCampaign, int] | None:
        """The campaign with the run that is to be played next; None where there is none."""
        number = self.store.next_run(campaign)
        return None if number is None or self._bar(campaign, number) else (campaign, number)

    def _waited(self, campaign: LinkCampaign, number: int) -> bool:
        """Let the water come to rest after the run before; False where the campaign is to go no further."""
        pause = campaign.runs[number - 1].wait_s / self.speed if number else 0.0
        ends = time.monotonic() + pause
        while not (bar := self._bar(campaign, number)) and (pause := ends - time.monotonic()) > 0:
            time.sleep(min(TICK_S, pause))
        return not bar

    def _run(self, campaign: LinkCampaign, number: int) -> None:
        name = campaign.log_name(campaign.runs[number])
        bar = ""

        def over() -> bool:
            nonlocal bar
            bar = bar or self._bar(campaign, number)
            return bool(bar)

        try:
            file = self.store.begin(name, campaign.room(campaign.runs[number]))
        except OutputError as why:
            self._end(campaign, str(why))
            return
        try:
            with contextlib.closing(self.vehicle.drive(campaign, number, over)) as lines:
                for line in lines:
                    self.store.write(file, name, line)
        except Exception as why:  # nobody is asked: what fails now, however it does, would fail in the next run
            bar = str(why) if isinstance(why, AutomarineError) else f"the vehicle failed ({type(why).__name__}: {why})"
            if isinstance(why, StuckError):
                raise
        finally:
            os.close(file)
            if bar and bar != GONE:
                self._end(campaign, bar)
            try:
                self.store.close(name, STOPPED if campaign.id in self._ended else INTERRUPTED if bar else WHOLE)
            except OSError as why:
                self._end(campaign, f"{name} could not be closed ({why.strerror})")

    def _end(self, campaign: LinkCampaign, why: str) -> None:
        """End a campaign for good, here and if possible on the disk."""
        self._ended.setdefault(campaign.id, why)
        with contextlib.suppress(OSError):
            self.store.stop(why, [campaign.id])


def play(store: Store, vehicle: Vehicle, speed: float, word: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lease = Lease(store, word)
    while lease.holds():  # a player of a server that was killed may still be closing its run
        try:
            with held(store.folder / ".player"):
                Player(store, vehicle, speed, lease.holds).play()
                return
        except HeldElsewhereError:
            time.sleep(TICK_S)
        except StuckError:
            os._exit(1)  # with the thread that hangs, so that its command never leaves
