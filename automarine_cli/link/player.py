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
from automarine_cli.link.vehicles.base import Vehicle

LEASE_S = 3.0
"""A server that has not been heard of for so long is gone."""
TICK_S = 0.1


class Lease:
    """Whether the server that started this player still lives: it touches a file that holds its word.

    Time is this process's own: a vehicle's wall clock may jump when it hears of the true time."""

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
    _ended: set[str] = field(default_factory=set)
    """Campaigns that ended here, whatever the disk says of them."""

    def play(self) -> None:
        with contextlib.suppress(OSError):  # a log that stays open is never begun again
            self.store.close_leftovers()
        while self.lives():
            for campaign, number in self.store.waiting():
                if not self._waited(campaign, number):
                    break
                self._run(campaign, number)
                if not self.lives():
                    return
            time.sleep(TICK_S)

    def _waited(self, campaign: LinkCampaign, number: int) -> bool:
        """Let the water come to rest after the run before; False where the campaign is to go no further."""
        pause = campaign.runs[number - 1].wait_s / self.speed if number else 0.0
        ends = time.monotonic() + pause
        while not (over := self._over(campaign)) and (pause := ends - time.monotonic()) > 0:
            time.sleep(min(TICK_S, pause))
        return not over

    def _over(self, campaign: LinkCampaign) -> bool:
        return campaign.id in self._ended or self.store.is_stopped(campaign) or not self.lives()

    def _run(self, campaign: LinkCampaign, number: int) -> None:
        name = campaign.log_name(campaign.runs[number])
        halted = False

        def over() -> bool:
            nonlocal halted
            halted = halted or self._over(campaign)
            return halted

        try:
            file = self.store.begin(name, campaign.room(campaign.runs[number]))
        except OutputError as why:
            self._end(campaign, why)
            return
        try:
            with contextlib.closing(self.vehicle.drive(campaign, number, over)) as lines:
                for line in lines:
                    self.store.write(file, name, line)
        except (AutomarineError, OSError) as why:  # nobody is asked: what is refused now is refused in the next run
            self._end(campaign, why)
            halted = True
        finally:
            os.close(file)
        stopped = halted and (campaign.id in self._ended or self.store.is_stopped(campaign))
        try:
            self.store.close(name, STOPPED if stopped else INTERRUPTED if halted else WHOLE)
        except OSError as why:
            self._end(campaign, why)

    def _end(self, campaign: LinkCampaign, why: Exception) -> None:
        self._ended.add(campaign.id)
        with contextlib.suppress(AutomarineError, OSError):
            self.store.stop(str(why), [campaign.id])


def play(store: Store, vehicle: Vehicle, speed: float, word: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lease = Lease(store, word)
    while lease.holds():  # a player of a server that was killed may still be closing its run
        with contextlib.suppress(HeldElsewhereError), held(store.folder / ".player"):
            Player(store, vehicle, speed, lease.holds).play()
            return
        time.sleep(TICK_S)
