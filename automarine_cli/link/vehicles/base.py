"""What drives runs, as the player knows it, and the clock that it keeps.

A vehicle's `drive` yields the lines of the run's log, each when its time has come, with the command as it was sent;
before every command it asks `halted`, and then sends none but neutral. The head comes before the first command."""

import _thread
import time
from collections.abc import Callable, Generator
from concurrent.futures import Future
from typing import Protocol, TypeVar

from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign

Halted = Callable[[], bool]
Answer = TypeVar("Answer")


class StuckError(SettingError):
    """A call to the actuator that did not return: what it was to do may still come, unless its process ends."""


class Vehicle(Protocol):
    """Whatever can drive a run. It is handed to a process of its own."""

    def refuse(self, campaign: LinkCampaign) -> None:
        """Raise SettingError for a campaign that it cannot drive."""

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        """Yield the lines of a run's log; end early when `halted`, after neutral. What it raises stops the campaign."""


def refuse_beyond(campaign: LinkCampaign, full: float) -> None:
    """Raise SettingError for a campaign with a moment that is larger than the vehicle's whole output, `full`."""
    for run in campaign.runs:
        if not (largest := max(abs(moment) for moment, _ in run.commands)) <= full * (1.0 + 1e-9):
            raise SettingError(
                f"run {run.name} asks for a moment of {largest:g} {campaign.moment_unit}, and the whole output gives "
                f"{full:g}; plan with moments.largest = {full:g} in the limits, or correct --full"
            )


def in_time(call: Callable[[], Answer], seconds: float, name: str) -> Answer:
    """Return what a call to the actuator `name` returns. Raises what it raises, and StuckError for none in time."""
    answer = Future[Answer]()

    def work() -> None:
        try:
            answer.set_result(call())
        except Exception as problem:
            answer.set_exception(problem)

    _thread.start_new_thread(work, ())  # for a command that is late by no more than a switch; nobody waits for its end
    try:
        return answer.result(seconds)
    except TimeoutError:
        if answer.done():  # it is the call's own
            raise
    raise StuckError(f"{name} did not take a command in {seconds:g} s; look at its cable and adapter")


class Pace:
    """Waits until so many seconds of a run have passed, `speed` times as fast as the clock."""

    def __init__(self, speed: float) -> None:
        self._speed, self._begun = speed, time.monotonic()

    @property
    def passed(self) -> float:
        return (time.monotonic() - self._begun) * self._speed

    def left(self, seconds: float) -> float:
        """How long it is by the clock [s] until `seconds` of the run have passed."""
        return self._begun + seconds / self._speed - time.monotonic()

    def until(self, seconds: float) -> None:
        if (wait := self.left(seconds)) > 0:
            time.sleep(wait)
