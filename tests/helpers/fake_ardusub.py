"""A vehicle with ArduSub on the loopback, of a known yaw model: MAVLink by pymavlink, sticks, modes, failsafes.

What is ArduSub's own is written down here a second time from its source: the way of a stick to the pulses of a frame,
and what it does when sticks or heartbeats stay away. Packets of one peer reach all others, as over a router.
"""

import contextlib
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from made_link import BATTERY
from made_outputs import mixed, sub_parameters
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from automarine_cli.link.document import CAMPAIGN_SCHEMA, LinkCampaign, PlannedRun
from automarine_cli.link.vehicles.ardusub.packets import Clock
from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub

STEP_S = 0.005
MANUAL, STABILIZE = 19, 0
SAFE = {
    "FS_PILOT_INPUT": 2.0, "FS_PILOT_TIMEOUT": 3.0, "FS_GCS_ENABLE": 2.0, "SYSID_MYGCS": 255.0, "JS_GAIN_DEFAULT": 0.5,
    "ACRO_YAW_P": 3.375, "RC4_MIN": 1100.0, "RC4_TRIM": 1500.0, "RC4_MAX": 1900.0, "RC4_DZ": 40.0, "RC4_REVERSED": 0.0,
}  # fmt: skip
"""Parameters as ArduSub is delivered."""
PORTS: list[socket.socket] = []
"""What is open; a test closes them when it is over."""
STATIONS = ("SYSID_MYGCS", "MAV_GCS_SYSID")


@dataclass(frozen=True)
class Packet:
    """One packet that reached the vehicle: when by its own clock [s], from whom, and what it says."""

    time: float
    system: int
    component: int
    name: str
    message: Any


@dataclass
class FakeSub:
    """`I_r` r' = tau - `k_rr` r|r|; `parameters` beside those that are `SAFE`; `gain` of the pilot now.

    `sinks` [m/s] while it is armed; `stray` is added to its yaw output; `mute` it says nothing, `deaf` it sends at its
    own rates. A parameter that is NaN it does not know. It was first driven in MANUAL at `driven_since` [s].
    """

    I_r: float = 0.8
    k_rr: float = 1.2
    gain: float = 1.0
    frame: int = 2
    parameters: dict[str, float] = field(default_factory=dict)
    heading: float = 40.0
    depth: float = 0.5
    sinks: float = 0.0
    charge_percent: float = 100.0
    tether: float = 0.0
    stray: float = 0.0
    mute: bool = False
    kind: int = mavlink.MAV_TYPE_SUBMARINE
    armable: bool = True
    held: float = 0.0
    deaf: bool = False
    packets: list[Packet] = field(default_factory=list)
    time: float = 100.0
    armed: bool = False
    mode: int = MANUAL
    rate: float = 0.0
    output: float = 0.0
    disarmed_by: str = ""
    driven_since: float = math.inf

    def __post_init__(self) -> None:
        self.parameters = SAFE | sub_parameters(self.frame) | self.parameters
        self._port = _port()
        self._port.bind(("127.0.0.1", 0))
        self._port.setblocking(False)
        self._peers: dict[tuple[str, int], Any] = {}
        self._mav = mavlink.MAVLink(self, 1, 1)
        self._stick = 0
        self._stuck = self._beaten = -math.inf
        self._hold = (math.radians(self.heading), 0.0)
        self._due = {1: 0.0, 30: 0.0, 36: 0.0, 74: 0.0, 33: 0.0, 0: 0.0, 251: 0.0}
        self._every = {1: 0.5, 30: 0.25, 36: 0.25, 74: 0.5, 33: 0.5, 0: 1.0, 251: 0.5}
        self._psi = math.radians(self.heading)
        self._noise = np.random.default_rng(5)

    @property
    def address(self) -> str:
        return f"udpout:127.0.0.1:{self._port.getsockname()[1]}"

    @property
    def turned(self) -> float:
        """How far it has turned since it was made [deg]."""
        return math.degrees(self._psi) - self.heading

    def call(self, port: int) -> None:
        """Send to a port from now on, as a vehicle's router does."""
        self._peers.setdefault(("127.0.0.1", port), mavlink.MAVLink(None))

    def sticks(self) -> list[Packet]:
        return [packet for packet in self.packets if packet.name == "MANUAL_CONTROL"]

    def commanded(self) -> list[Packet]:
        """Sticks that are not in the middle."""
        return [packet for packet in self.sticks() if packet.message.r]

    def write(self, data: bytes) -> None:
        if not self.mute:
            for peer in self._peers:
                self._port.sendto(data, peer)

    def advance(self, seconds: float) -> None:
        ends = self.time + seconds
        while self.time < ends - 1e-9:
            self._take()
            self._step(min(STEP_S, ends - self.time))
            for number, due in self._due.items():
                if self.time >= due:
                    self._due[number] = max(due + self._every[number], self.time)
                    self._tell(number)

    def pulses(self) -> list[int]:
        """What its outputs are sent [us]."""
        wished = {"tau": np.array([self.output + self.stray if self.armed else 0.0])}
        return [int(pulse) for pulse in mixed(wished, self.frame)[:, 0]]

    def heard(self, packet: Packet) -> None:
        """Nothing; for who wants to act on a packet."""

    def disarm(self, why: str) -> None:
        self.armed, self.disarmed_by = False, why
        self._mav.statustext_send(2, why.encode())

    def _take(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                data, sender = self._port.recvfrom(2048)
                parser = self._peers.setdefault(sender, mavlink.MAVLink(None))
                for message in parser.parse_buffer(data) or ():
                    who = message.get_srcSystem(), message.get_srcComponent()
                    self.packets.append(Packet(self.time, *who, message.get_type(), message))
                    self.heard(self.packets[-1])
                    self._obey(message)
                if not self.mute:
                    for peer in self._peers:
                        if peer != sender:
                            self._port.sendto(data, peer)

    def _obey(self, message: Any) -> None:
        name, ours = message.get_type(), message.get_srcSystem() in map(self.parameters.get, STATIONS)
        if name == "MANUAL_CONTROL" and ours and message.target == 1:
            self._stick, self._stuck = message.r, self.time
            if message.r and self.armed and self.mode == MANUAL:
                self.driven_since = min(self.driven_since, self.time)
        elif name == "HEARTBEAT" and ours:
            self._beaten = self.time
        elif name == "PARAM_REQUEST_READ":
            known = message.param_id
            if not math.isnan(self.parameters.get(known, math.nan)):
                self._mav.param_value_send(known.encode(), self.parameters[known], 9, 100, 0)
        elif name == "COMMAND_LONG":
            self._mav.command_ack_send(message.command, self._command(message.command, message.param1, message.param2))

    def _command(self, number: int, first: float, second: float) -> int:
        if number == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            self._every[int(first)] = self._every[int(first)] if self.deaf else second / 1e6
            self._due[int(first)] = self.time
        elif number == mavlink.MAV_CMD_DO_SET_MODE:
            self.mode, self._hold = int(second), (self._psi, 0.0)
        elif number == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            if first and not self.armable:
                self._mav.statustext_send(2, b"Arm: Depth sensor is not connected")
                return mavlink.MAV_RESULT_FAILED
            self.armed = bool(first)
        else:
            return mavlink.MAV_RESULT_UNSUPPORTED
        return mavlink.MAV_RESULT_ACCEPTED

    def _step(self, step: float) -> None:
        self.time += step
        known = self.parameters
        if self.armed and known["FS_PILOT_INPUT"] == 2 and self.time - self._stuck > known["FS_PILOT_TIMEOUT"]:
            self.disarm("Lost manual control")
        if self.armed and known["FS_GCS_ENABLE"] == 2 and self.time - self._beaten > 3.0:
            self.disarm("MYGCS: 255, heartbeat lost")
        self.output = self.manual_output(self._stick) if self.mode == MANUAL else self._stabilised(step)
        tau = np.clip(self.output + self.stray, -1, 1) if self.armed else 0.0
        middle = self.rate + 0.5 * step * (tau - self.k_rr * self.rate * abs(self.rate)) / self.I_r
        self.rate += step * (tau - self.k_rr * middle * abs(middle)) / self.I_r
        self._psi += step * middle
        self.depth += step * self.sinks * self.armed

    def manual_output(self, stick: int) -> float:
        known, off = self.parameters, int(1500 + stick * 0.4 * self.gain) - 1500
        span = known["RC4_MAX"] - 1500 if off > 0 else 1500 - known["RC4_MIN"]
        way = -1 if known["RC4_REVERSED"] else 1
        return float(np.clip(way * off / span * known["ACRO_YAW_P"] / 3.375, -1, 1))

    def _stabilised(self, step: float) -> float:
        """The stick is a turn rate beyond its dead zone; in the middle the heading is held after a quarter second."""
        known, off = self.parameters, int(1500 + self._stick * 0.4 * self.gain) - 1500
        dead = known["RC4_DZ"] * self.gain
        way = -1 if known["RC4_REVERSED"] else 1
        share = way * math.copysign(max(abs(off) - dead, 0.0) / (400 - dead), off)
        wanted = math.radians(45 * share * known["ACRO_YAW_P"])
        heading, since = self._hold
        if wanted or since < 0.25:
            self._hold = (self._psi, 0.0 if wanted else since + step)
        else:
            wanted = 1.5 * (heading - self._psi)
        return float(np.clip(3.0 * (wanted - self.rate), -1, 1))

    def _tell(self, number: int) -> None:
        ms, yaw = int(self.time * 1e3), self._psi + math.radians(self._noise.normal(0, 0.2))
        if number == 0:
            base = 81 | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0)
            self._mav.heartbeat_send(self.kind, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, base, self.mode, 4)
        elif number == 1:
            left = -1 if math.isnan(self.charge_percent) else int(self.charge_percent)
            self._mav.sys_status_send(0, 0, 0, 500, 15800, 400, left, 0, 0, 0, 0, 0, 0)
        elif number == 30:
            rate = self.rate + math.radians(self._noise.normal(0, 0.1))
            self._mav.attitude_send(ms, 0, 0, (yaw + math.pi) % math.tau - math.pi, 0, 0, rate)
        elif number == 36:
            self._mav.servo_output_raw_send(int(self.time * 1e6) % 2**32, 0, *self.pulses())
        elif number == 74:
            self._mav.vfr_hud_send(0, 0, int(math.degrees(self._psi)) % 360, 0, 0.0, 0)  # its estimator has no origin
        elif number == 33:
            self._mav.global_position_int_send(ms, 0, 0, 0, int(-1e3 * self.depth), 0, 0, 0, 0)
        else:
            turns = self.tether + self.turned / 360.0
            for name, value in (("PilotGain", self.gain), ("InputHold", self.held), ("TetherTrn", turns)):
                self._mav.named_value_float_send(ms, name.encode(), value)


def _port() -> socket.socket:
    PORTS.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    return PORTS[-1]


@dataclass
class Tank(Clock):
    """The time of a vehicle that lives on while somebody sleeps, and of `others`, who act then."""

    vehicle: FakeSub
    others: Sequence[Callable[[], object]] = ()

    def now(self) -> float:
        return self.vehicle.time

    def sleep(self, seconds: float) -> None:
        for other in self.others:
            other()
        self.vehicle.advance(max(seconds, 1e-4))


@dataclass
class Station:
    """Another ground station on the vehicle's link."""

    vehicle: FakeSub
    system: int = 255
    component: int = 191

    def __post_init__(self) -> None:
        self._port = _port()
        self.mav = mavlink.MAVLink(self, self.system, self.component)

    def write(self, data: bytes) -> None:
        host, port = self.vehicle.address.removeprefix("udpout:").split(":")
        self._port.sendto(data, (host, int(port)))

    def beat(self) -> None:
        self.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def push(self) -> None:
        self.mav.manual_control_send(1, 0, 0, 500, 300, 0)


@contextlib.contextmanager
def alive(vehicle: FakeSub) -> Iterator[FakeSub]:
    """The vehicle lives by the computer's clock, in a thread, as long as the block lasts."""
    ends = threading.Event()

    def live() -> None:
        begun, first = time.monotonic(), vehicle.time
        while not ends.wait(0.005):
            vehicle.advance(time.monotonic() - begun - (vehicle.time - first))

    thread = threading.Thread(target=live)
    thread.start()
    try:
        yield vehicle
    finally:
        ends.set()
        thread.join()


def campaign_of(*moments: float, seconds: float = 4.0, **changed: Any) -> LinkCampaign:
    """A run for each moment: a second of rest, the moment, two seconds of coasting."""
    runs = tuple(
        PlannedRun(f"{i:02d}_step_{moment:+g}", ((moment, seconds), (0.0, 2.0)), 90.0 * (i % 4), 5.0)
        for i, moment in enumerate(moments, 1)
    )
    return LinkCampaign(CAMPAIGN_SCHEMA, "nu", 10.0, 1.0, replace(BATTERY, **changed), runs)


def flown(vehicle: FakeSub, campaign: LinkCampaign, *others: Callable[[], object], **more: Any) -> list[str]:
    """The lines of the campaign's first run; `others` act whenever time goes on."""
    sub = ArduSub(vehicle.address, clock=Tank(vehicle, others), **more)
    return list(sub.drive(campaign, 0, lambda: False))
