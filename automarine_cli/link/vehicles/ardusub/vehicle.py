"""ArduSub plays campaigns: each run is turned to its heading in STABILIZE, driven in MANUAL, turned back, disarmed."""

import math
from collections.abc import Generator, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import Annotated

import numpy as np

from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.ardusub.packets import STICK_HZ, Attitude, Clock, Halt, Link, reached_by
from automarine_cli.link.vehicles.ardusub.preflight import Stick, another_pilot, authority, preflight
from automarine_cli.link.vehicles.base import Halted
from automarine_cli.logs.mixing import Part
from automarine_cli.planning.candidates import MOMENT_COLUMNS
from automarine_cli.simulation.specification import Limit, Settings
from automarine_cli.thrusters.map import TwinThrusters

STABILIZE, MANUAL = 0, 19
DO_SET_MODE, ARM_DISARM = 176, 400
NEUTRAL_STICKS = 10  # so many sticks in the middle come before silence
MAX_SILENT_S, STALE_S = 3.0, 1.0  # so long may the vehicle, and its attitude, not be heard
MAX_OUTPUT_ERROR, MAX_OUTPUT_ERROR_S = 0.1, 1.0  # how far, and for how long, the outputs may be from what was sent
TURN_DEG_S, SLOWEST_DEG_S, PER_S = 20.0, 4.0, 0.5  # turning to a heading: fastest, slowest, for each degree left
NEAR_DEG, STILL_DEG_S, STILL_S = 3.0, 1.0, 1.0
TURN_PATIENCE_S = 30.0


@dataclass(frozen=True)
class ArduSubLimits(Settings):
    """How deep [m] the vehicle may come (inf: any), and how far [deg] a run may turn it, to either side."""

    depth: Annotated[float, Limit(0.1)] = math.inf
    heading: Annotated[float, Limit(0.1)] = 1080.0


class RunSession:
    def __init__(self, link: Link, stick: Stick, part: Part, authority: TwinThrusters, limits: ArduSubLimits) -> None:
        self._link, self._stick, self._part, self._authority, self._limits = link, stick, part, authority, limits
        self._mode, self._is_armed = STABILIZE, False
        self._untwisted = self._heading - 360.0 * link.heard.named_values.get("TetherTrn", 0.0)

    @property
    def _heading(self) -> float:
        heading = self._link.heard.heading
        assert heading is not None  # its rate was checked
        return heading

    @property
    def twist(self) -> float:
        """How far the tether is twisted [deg], clockwise: what the vehicle counted before, and what it turned since."""
        return self._heading - self._untwisted

    def begin(self, heading: float) -> None:
        self._link.steady = True
        self._enter(STABILIZE)
        self._still(1.0)
        self._is_armed = True  # it may be from here on, though the answer be lost
        if not (self._link.command(ARM_DISARM, 1.0) and self._link.wait(MAX_SILENT_S, lambda: self._link.heard.armed)):
            raise SettingError(f"the vehicle does not arm ({self._last_words}); correct what it complains of")
        self._turn_to(heading)
        self._enter(MANUAL)

    def head(self, campaign: LinkCampaign, name: str) -> str:
        tether = f"{self.twist / 360.0:+.2f} turns in the tether"
        columns = ("time_s", "heading_deg", "yaw_rate_deg_s", MOMENT_COLUMNS[campaign.moment_unit])
        outputs = (f"servo{number}_us" for number in self._part.channels)
        return (
            f"# Driven by ArduSub, {name}: pilot gain {self._stick.gain:g}, {tether}.\n"
            f"{','.join((*columns, 'voltage_V', 'depth_m', 'stick', *outputs))}\n"
        )

    def lines(self, campaign: LinkCampaign, number: int) -> Iterator[str]:
        """The rows of the run's log, each when its time has come. Raises SettingError, Halt."""
        run, link = campaign.runs[number], self._link
        moments = np.array([moment for moment, _ in run.commands])
        outputs = (0.0, *map(self._authority.output, moments), 0.0)
        edges = list(accumulate((campaign.rest_s, *(seconds for _, seconds in run.commands))))
        begun, start, agreed = link.now(), self._heading, link.now()
        link.heard.readings.clear()
        due = begun
        while (since := link.now() - begun) < edges[-1] + 2.0 / STICK_HZ:
            self._send(yaw := self._stick.manual(outputs[np.searchsorted(edges, since, side="right")]))
            output, sent = self._output(link.heard.pulses), self._stick.output(yaw)
            agreed = link.now() if abs(output - sent) < MAX_OUTPUT_ERROR else agreed
            if link.now() - agreed > MAX_OUTPUT_ERROR_S:
                raise SettingError(
                    f"the vehicle's yaw output is {output:+.2f}, and {sent:+.2f} was sent; check who else commands it, "
                    "and that nobody changed its gain"
                )
            if abs(self._heading - start) > (most := self._limits.heading):
                remedy = "plan shorter commands, or give another --heading-limit"
                raise SettingError(f"the vehicle turned {most:g} deg from where run {run.name} began; {remedy}")
            yield from self.rows()
            due = max(due + 1.0 / STICK_HZ, link.now())  # what was missed is not sent in a burst
            link.wait(due - link.now())

    def rows(self) -> Iterator[str]:
        while self._link.heard.readings:
            yield self._row(self._link.heard.readings.popleft())

    def unwind(self, heading: float) -> None:
        """Turn to a heading [deg] where the run twisted the tether. Raises SettingError, Halt."""
        if abs(self.twist) > 180.0:
            self._enter(STABILIZE)
            self._turn_to(heading)

    def end(self) -> None:
        """Sticks in the middle, and disarm; where that is not heard, the dead-man does it in the silence after it."""
        self._link.halted = lambda: False
        if self._is_armed:
            with suppress(SettingError):  # what is not heard any more may still hear the word to disarm
                self._still(NEUTRAL_STICKS / STICK_HZ, checked=False)
            self._link.steady = False
            self._link.command(ARM_DISARM, 0.0)

    @property
    def _last_words(self) -> str:
        return self._link.heard.text or "it does not say why"

    def _turn_to(self, heading: float) -> None:
        """Turn in STABILIZE until it is still there, on the way that leaves the tether twisted least."""
        short = (heading - self._heading + 180.0) % 360.0 - 180.0
        target = self._heading + short - 360.0 * round((self.twist + short) / 360.0)
        most = TURN_PATIENCE_S + abs(target - self._heading) / SLOWEST_DEG_S
        ends, still_s = self._link.now() + most, 0.0
        while still_s < STILL_S:
            error = target - self._heading
            rate = np.copysign(np.clip(PER_S * abs(error), SLOWEST_DEG_S, TURN_DEG_S), error)
            aligned = abs(error) < NEAR_DEG
            self._send(0 if aligned else self._stick.turn(float(rate)))
            self._link.wait(1.0 / STICK_HZ)
            still_s = still_s + 1.0 / STICK_HZ if aligned and abs(self._link.heard.rate) < STILL_DEG_S else 0.0
            if self._link.now() > ends:
                raise SettingError(
                    f"the vehicle did not come to the heading {heading:g} deg in {most:.0f} s; check its yaw gains, "
                    "its compass and its tether"
                )

    def _enter(self, mode: int) -> None:
        self._still(NEUTRAL_STICKS / STICK_HZ, checked=self._is_armed)
        link = self._link
        if not (link.command(DO_SET_MODE, 1.0, mode) and link.wait(MAX_SILENT_S, lambda: link.heard.mode == mode)):
            why = f"({self._last_words}); check what commands it"
            raise SettingError(f"the vehicle does not change to mode {mode} {why}")
        self._mode = mode

    def _still(self, seconds: float, checked: bool = True) -> None:
        for _ in range(round(seconds * STICK_HZ)):
            self._send(0, checked)
            self._link.wait(1.0 / STICK_HZ)

    def _send(self, yaw: int, checked: bool = True) -> None:
        """Send a stick, if all is as it should be. Raises SettingError, Halt."""
        self._link.poll()
        if checked and self._is_armed:
            self._check()
        self._link.stick(yaw)

    def _check(self) -> None:
        heard, now, deepest = self._link.heard, self._link.now(), self._limits.depth
        if now - heard.last["HEARTBEAT"] > MAX_SILENT_S or now - heard.last["ATTITUDE"] > STALE_S:
            raise SettingError("the vehicle was not heard any more; check the link, and where the vehicle is")
        if not heard.armed:
            raise SettingError(f"the vehicle disarmed itself ({self._last_words}); correct that first")
        if heard.mode != self._mode:
            remedy = "ask who else commands it, then make a new plan"
            raise SettingError(f"somebody changed the mode to {heard.mode}; {remedy}")
        if other := another_pilot(heard):
            raise SettingError(other)
        if (depth := heard.depth or 0.0) > deepest:
            raise SettingError(f"the vehicle is {depth:.1f} m deep, below --depth-limit; make it float, then plan anew")

    def _output(self, pulses: dict[int, float]) -> float:
        return float(self._part.wishes(np.array([[pulses.get(number, 0.0)] for number in self._part.channels]))[0, 0])

    def _row(self, at: Attitude) -> str:
        moment = float(self._authority.moment(np.array(self._output(at.pulses))))
        more = ("" if value is None else f"{value:.2f}" for value in (at.volts, at.depth))
        outputs = (f"{at.pulses.get(number, 0.0):.0f}" for number in self._part.channels)
        first = (f"{at.time:.3f}", f"{at.heading % 360.0:.3f}", f"{at.rate:.3f}", f"{moment + 0.0:.5g}")
        return f"{','.join((*first, *more, str(at.stick), *outputs))}\n"


@dataclass(frozen=True)
class ArduSub(Settings):
    """ArduSub at a MAVLink address; the whole output gives `full`, or what two `thrusters` at an `arm` [m] do."""

    address: str
    full: Annotated[float, Limit(1e-9, 1e9)] | None = None
    thrusters: Path | None = None
    arm: float | None = None
    limits: ArduSubLimits = field(default_factory=ArduSubLimits)
    clock: Clock = field(default_factory=Clock)

    def __post_init__(self) -> None:
        reached_by(self.address)
        super().__post_init__()

    def refuse(self, campaign: LinkCampaign) -> None:
        self._authority(campaign)

    def look(self, campaign: LinkCampaign) -> None:
        """Check the vehicle as before a run, and command nothing. Raises SettingError."""
        with closing(Link(self.address, lambda: False, self.clock)) as link:
            preflight(link, campaign, 0, self._authority(campaign), self.limits.depth)

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        """Yield the lines of a run's log: the moment as the vehicle's outputs made it, and the outputs.

        The vehicle is checked, armed, driven, turned back and disarmed, then there is silence. Raises SettingError
        where it must not be driven (any further)."""
        run, yaw_authority = campaign.runs[number], self._authority(campaign)
        after = campaign.runs[min(number + 1, len(campaign.runs) - 1)]
        with closing(Link(self.address, halted, self.clock)) as link, suppress(Halt):
            stick, part = preflight(link, campaign, number, yaw_authority, self.limits.depth)
            session = RunSession(link, stick, part, yaw_authority, self.limits)
            cut: Exception | None = None
            try:
                session.begin(run.start_heading_deg)
                yield session.head(campaign, campaign.log_name(run))
                try:
                    yield from session.lines(campaign, number)
                except (Halt, SettingError) as problem:
                    cut = problem
                else:
                    session.unwind(after.start_heading_deg)
            finally:
                session.end()
            if cut is not None:
                yield from session.rows()  # they end in neutral
                raise cut

    def _authority(self, campaign: LinkCampaign) -> TwinThrusters:
        return authority(campaign, self.full, self.thrusters, self.arm)
