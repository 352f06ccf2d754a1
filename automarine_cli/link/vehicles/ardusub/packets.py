"""The MAVLink connection: what is sent to an autopilot, and what was heard of it."""

import contextlib
import io
import math
import re
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from automarine_cli.errors import SettingError
from automarine_cli.link.vehicles.base import Halted
from automarine_cli.logs.streams import needed
from automarine_cli.logs.tlog import MAV_MODE_ARMED, NO_VOLTAGE
from automarine_cli.text import printable

STATION_ID = (255, 190)  # system and component that we send as: those of a ground station, whose sticks ArduSub takes
AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1: cameras and companions beat too, and some seem armed
STATION, NO_AUTOPILOT = 6, 8  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID
STICK_MESSAGES = ("MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE")
HEARTBEAT_S, LINK_POLL_S = 1.0, 0.01
STICK_HZ = 40.0
ACK_S, COMMAND_TRIES = 1.0, 3
ADDRESS = re.compile(r"(?P<way>udpin|udpout|tcp):(?P<where>[^:]+:\d{1,5})|serial:(?P<device>.+):(?P<baud>\d+)")


@dataclass(frozen=True)
class Attitude:
    """`time` [s] since the autopilot started, `heading` [deg, unwrapped], `rate` [deg/s]; `pulses` [us] by output,
    supply [V], `depth` [m] and the yaw `stick` sent, as they were then."""

    time: float
    heading: float
    rate: float
    pulses: dict[int, float]
    volts: float | None
    depth: float | None
    stick: int


@dataclass
class Heard:
    """What was heard so far; a time is the link's own [s]."""

    system: int | None = None
    autopilot: int = NO_AUTOPILOT
    kind: int = 0
    armed: bool = False
    mode: int = -1
    parameters: dict[str, float] = field(default_factory=dict)
    named_values: dict[str, float] = field(default_factory=dict)
    pulses: dict[int, float] = field(default_factory=dict)
    heading: float | None = None
    rate: float = 0.0
    depths: dict[str, float] = field(default_factory=dict)
    volts: float | None = None
    remaining_percent: float | None = None
    text: str = ""
    last: dict[str, float] = field(default_factory=dict)
    count: Counter[str] = field(default_factory=Counter)
    answers: dict[int, int] = field(default_factory=dict)
    senders: dict[tuple[int, int], str] = field(default_factory=dict)
    stations: set[tuple[int, int]] = field(default_factory=set)
    readings: deque[Attitude] = field(default_factory=deque)

    @property
    def depth(self) -> float | None:
        """How deep it is [m]: two messages tell it, and one of them says 0 where its estimator has no origin."""
        return max(self.depths.values(), default=None)


class Halt(Exception):
    pass


class Clock:
    """The computer's own [s]; a simulated autopilot has another."""

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


class Link:
    """A connection: sends our heartbeat while it is polled, and while it is `steady` sticks in the middle."""

    def __init__(self, address: str, halted: Halted, clock: Clock) -> None:
        """Open an address. Raises SettingError for one that is none, or that cannot be opened."""
        self.address, self.halted, self.heard, self.now = address, halted, Heard(), clock.now
        self._clock, self._beat, self._stick, self._sent, self.steady = clock, -math.inf, 0, -math.inf, False
        self._port = _opened(address)
        self._mav = _library("pymavlink.dialects.v20.ardupilotmega").MAVLink(self._port, *STATION_ID)
        self._mav.robust_parsing = True

    def poll(self) -> None:
        """Send what is due, and take what came. Raises Halt, and SettingError where the connection broke."""
        if self.halted():
            raise Halt
        if self.now() - self._beat >= HEARTBEAT_S:
            self._beat = self.now()
            self._mav.heartbeat_send(STATION, NO_AUTOPILOT, 0, 0, 0)
        if self.steady and not self._stick and self.now() - self._sent > 1.5 / STICK_HZ:
            self.stick(0)  # the vehicle's dead-man may wait for 0.1 s only, and an answer takes longer
        try:
            while data := self._port.recv(4096):
                for message in self._mav.parse_buffer(data) or ():
                    self._hear(message)
        except OSError as problem:
            raise SettingError(f"{self.address}: the connection broke ({problem}); check the cable") from None

    def wait(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Poll for so long, or until something is so; whether it is."""
        ends = self.now() + seconds
        while True:
            self.poll()
            if until() or self.now() >= ends:
                return until()
            self._clock.sleep(max(min(LINK_POLL_S, ends - self.now()), 0.0))

    def stick(self, yaw: int) -> None:
        """Send the sticks: yaw from -1000 to 1000, all others in the middle."""
        self._stick, self._sent = yaw, self.now()
        self._mav.manual_control_send(self.heard.system, 0, 0, 500, yaw, 0)

    def command(self, number: int, *values: float) -> bool:
        for _ in range(COMMAND_TRIES):
            self.heard.answers.pop(number, None)
            seven = (*values, 0, 0, 0, 0, 0, 0, 0)[:7]
            self._mav.command_long_send(self.heard.system, AUTOPILOT, number, 0, *seven)
            if self.wait(ACK_S, lambda: number in self.heard.answers):
                return self.heard.answers[number] == 0
        return False

    def ask(self, names: Iterable[str]) -> None:
        """Ask for parameters by name, all at once; who does not know one says nothing."""
        for name in names:
            self._mav.param_request_read_send(self.heard.system, AUTOPILOT, name.encode(), -1)

    def close(self) -> None:
        self._port.close()

    def _hear(self, message: Any) -> None:
        name, who = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
        heard = self.heard
        if name in STICK_MESSAGES:
            heard.senders[who] = name
        elif name == "HEARTBEAT" and message.type == STATION:
            heard.stations.add(who)
        elif name == "HEARTBEAT" and heard.system is None and who[1] == AUTOPILOT and message.autopilot != NO_AUTOPILOT:
            heard.system = who[0]
        if who != (heard.system, AUTOPILOT):
            return
        heard.last[name] = self.now()
        heard.count[name] += 1
        if name == "HEARTBEAT":
            heard.autopilot, heard.kind, heard.mode = message.autopilot, message.type, message.custom_mode
            heard.armed = bool(message.base_mode & MAV_MODE_ARMED)
        elif name == "ATTITUDE":
            heading = math.degrees(message.yaw)
            before = heading if heard.heading is None else heard.heading
            heard.heading = before + (heading - before + 180.0) % 360.0 - 180.0
            heard.rate = math.degrees(message.yawspeed)
            more = (dict(heard.pulses), heard.volts, heard.depth, self._stick)
            heard.readings.append(Attitude(message.time_boot_ms / 1e3, heard.heading, heard.rate, *more))
        elif name == "SERVO_OUTPUT_RAW" and message.port == 0:
            pulses = {n: getattr(message, f"servo{n}_raw", 0) for n in range(1, 17)}
            heard.pulses = {n: float(pulse) for n, pulse in pulses.items() if pulse}
        elif name == "PARAM_VALUE":
            heard.parameters[message.param_id] = message.param_value
        elif name == "NAMED_VALUE_FLOAT":
            heard.named_values[message.name] = message.value
        elif name in ("VFR_HUD", "GLOBAL_POSITION_INT"):
            heard.depths[name] = -message.alt if name == "VFR_HUD" else -message.relative_alt / 1e3
        elif name == "SYS_STATUS":
            volts, percent = message.voltage_battery, message.battery_remaining
            heard.volts = None if volts == NO_VOLTAGE else volts / 1e3
            heard.remaining_percent = None if percent < 0 else float(percent)
        elif name == "STATUSTEXT":
            heard.text = printable(message.text)
        elif name == "COMMAND_ACK":
            heard.answers[message.command] = message.result


def reached_by(address: str) -> re.Match[str]:
    """The parts of an address. Raises SettingError for one that is none, LogError where a library is not installed."""
    parts = ADDRESS.fullmatch(address)
    _library("serial" if parts and parts["device"] else "pymavlink")
    if not parts:
        raise SettingError(
            f"found the address {printable(address)!r}, expected udpin:0.0.0.0:PORT, udpout:HOST:PORT, "
            "tcp:HOST:PORT or serial:DEVICE:BAUD"
        )
    return parts


def _opened(address: str) -> Any:
    parts, connect = reached_by(address), _library("pymavlink.mavutil").mavlink_connection
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it tells of every try
            return connect(address) if parts["way"] else connect(parts["device"], baud=int(parts["baud"]))
    except (OSError, ValueError, OverflowError) as problem:
        raise SettingError(f"{address} cannot be opened ({problem}); check --mavlink, and what else has it") from None


def _library(module: str) -> Any:
    return needed(module, "ardupilot", "--vehicle ardusub", "MAVLink packets")
