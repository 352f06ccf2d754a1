"""What ArduSub makes of a yaw stick, what a moment asks of its output, and what must be so before it is armed."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from automarine_cli.control.knowledge import turning
from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.ardusub.packets import STATION_ID, Heard, Link
from automarine_cli.link.vehicles.base import refuse_beyond
from automarine_cli.logs.mixing import Part, Unclear, part_of
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap, TwinThrusters

STICK_CENTRE, STICK_SPAN = 1500.0, 0.4  # us: a stick in the middle, and what each thousandth adds at a gain of 1
USUAL = 3.375  # the ACRO_YAW_P at which a whole pulse is the whole output in MANUAL
ANGLE_DEG = 45.0  # A whole pulse in STABILIZE; times ACRO_YAW_P it is a turn rate [deg/s]
FULL_STICK = 1000


@dataclass(frozen=True)
class Stick:
    """The way of a yaw stick through ArduSub: pilot `gain`, ACRO_YAW_P, and how its channel is set [us]."""

    gain: float
    yaw_p: float
    down: float
    up: float
    way: float
    dead: float

    @classmethod
    def of(cls, heard: Heard) -> "Stick":
        """As the vehicle tells; what it does not tell is as delivered."""
        parameters = heard.parameters
        centre = parameters.get("RC4_TRIM", STICK_CENTRE)
        gain = heard.named_values.get("PilotGain", parameters.get("JS_GAIN_DEFAULT", 0.5))
        down, up = centre - parameters.get("RC4_MIN", 1100.0), parameters.get("RC4_MAX", 1900.0) - centre
        way = -1.0 if parameters.get("RC4_REVERSED", 0.0) else 1.0
        return cls(gain, parameters.get("ACRO_YAW_P", USUAL), down, up, way, parameters.get("RC4_DZ", 40.0))

    @property
    def reach(self) -> float:
        """The largest output, from 0 to 1, to whichever side it is less."""
        return min(abs(self.output(FULL_STICK)), abs(self.output(-FULL_STICK)))

    def output(self, yaw: int) -> float:
        off = int(STICK_CENTRE + yaw * STICK_SPAN * self.gain) - STICK_CENTRE
        share = self.way * off / (self.up if off > 0 else self.down)
        return float(np.clip(np.clip(share, -1.0, 1.0) * self.yaw_p / USUAL, -1.0, 1.0))

    def manual(self, output: float) -> int:
        return self._of_share(output * USUAL / self.yaw_p, 0.0)

    def turn(self, rate: float) -> int:
        """The stick that makes a turn rate [deg/s] in STABILIZE, beyond the dead zone of its channel."""
        return self._of_share(rate / (ANGLE_DEG * self.yaw_p), self.dead * self.gain) if rate else 0

    def _of_share(self, share: float, dead: float) -> int:
        signed = self.way * share
        span = self.up if signed > 0 else self.down
        off = dead + abs(signed) * (span - dead)
        return int(np.clip(round(np.copysign(off, signed) / (STICK_SPAN * self.gain)), -FULL_STICK, FULL_STICK))


def authority(campaign: LinkCampaign, full: float | None, thrusters: Path | None, arm: float | None) -> TwinThrusters:
    """What outputs give for a campaign; where nothing else is said the whole output is 1 nu. Raises SettingError."""
    straight = PowerCurve(0.5, p=1.0)
    twins = None if thrusters is None or arm is None else turning(ThrusterMap.load(thrusters), arm)
    unit = campaign.moment_unit
    if full is None:
        full = 1.0 if unit == "nu" else None if twins is None else twins.largest
    if full is None:
        raise SettingError(
            "the campaign's moments are in N m, and ArduSub commands outputs from -1 to 1; give --full with the moment "
            "[N m] of the whole output, or --thrusters MAP.json and --arm METRES"
        )
    refuse_beyond(campaign, full)
    return (twins or TwinThrusters(straight, straight, 1.0, 1.0)).scaled_to(full)


ARDUPILOT, SUBMARINE = 3, 12  # MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_TYPE_SUBMARINE
SET_MESSAGE_INTERVAL = 511
MESSAGE_RATES = {
    "ATTITUDE": (30, 25.0), "SERVO_OUTPUT_RAW": (36, 50.0), "VFR_HUD": (74, 5.0), "GLOBAL_POSITION_INT": (33, 5.0),
    "SYS_STATUS": (1, 2.0),
}  # fmt: skip
"""Messages that are asked for: their number, and how often a second."""
NAMED_S = 5.0
FIRST_S, PILOT_LISTEN_S, ASK_ROUNDS = 5.0, 3.0, 6
DISARMS = 2.0
LONGEST_PILOT_S = 3.0
PREFLIGHT_PARAMETERS = (
    "FS_PILOT_INPUT", "FS_PILOT_TIMEOUT", "FS_GCS_ENABLE", "SYSID_MYGCS", "MAV_GCS_SYSID", "MAV_GCS_SYSID_HI",
    "JS_GAIN_DEFAULT", "ACRO_YAW_P", "RC4_MIN", "RC4_TRIM", "RC4_MAX", "RC4_DZ", "RC4_REVERSED", "FRAME_CONFIG",
    *(f"SERVO{n}_FUNCTION" for n in range(1, 17)), *(f"MOT_{n}_DIRECTION" for n in range(1, 9)),
)  # fmt: skip


def preflight(
    link: Link, campaign: LinkCampaign, number: int, authority: TwinThrusters, depth_limit: float
) -> tuple[Stick, Part]:
    """Return how sticks work and outputs are read, of a vehicle that may be armed for a campaign from the run of a
    `number` on, down to `depth_limit` [m]. Raises SettingError."""
    if not link.wait(FIRST_S, lambda: "HEARTBEAT" in link.heard.last):
        remedy = "check --mavlink, and where the vehicle sends"
        raise SettingError(f"no autopilot was heard on {link.address} in {FIRST_S:g} s; {remedy}")
    heard = link.heard
    if (heard.autopilot, heard.kind) != (ARDUPILOT, SUBMARINE):
        expected = f"expected {ARDUPILOT} and {SUBMARINE} of ArduSub; check --mavlink"
        raise SettingError(f"the autopilot is MAV_AUTOPILOT {heard.autopilot} in a MAV_TYPE {heard.kind}, {expected}")
    for message, rate in MESSAGE_RATES.values():
        link.command(SET_MESSAGE_INTERVAL, message, 1e6 / rate)
    heard.count.clear()
    begun = link.now()
    for _ in range(ASK_ROUNDS):
        link.ask(name for name in PREFLIGHT_PARAMETERS if name not in heard.parameters)
        link.wait(PILOT_LISTEN_S / ASK_ROUNDS)
    link.wait(NAMED_S, lambda: "PilotGain" in heard.named_values)
    most = max(abs(moment) for run in campaign.runs[number:] for moment, _ in run.commands)
    output, seconds = authority.output(most), link.now() - begun
    for why in chain(_complaints(heard, output, seconds), _battery_and_depth(heard, campaign, number, depth_limit)):
        raise SettingError(why)
    return Stick.of(heard), outputs_are_known(heard)


def _complaints(heard: Heard, output: float, seconds: float) -> Iterator[str]:
    """Yield a sentence for each rule broken in so many seconds by a vehicle that has to reach an `output`."""
    parameters, station = heard.parameters, STATION_ID[0]
    if heard.armed:
        yield "the vehicle is armed already, so somebody else drives it; make them disarm it"
    # one that takes sticks from other ground stations only would pass ours over in silence
    name = "MAV_GCS_SYSID" if "MAV_GCS_SYSID" in parameters else "SYSID_MYGCS"
    if name not in parameters:
        yield "the vehicle tells no parameters, without which it is not driven; check the link, and start it again"
    elif not parameters[name] <= station <= max(parameters[name], parameters.get("MAV_GCS_SYSID_HI", 0.0)):
        yield f"{name} is {parameters[name]:g}, and sticks are taken from that system only; set it to {station}, ours"
    for name in ("FS_PILOT_INPUT", "FS_GCS_ENABLE"):
        if parameters.get(name) != DISARMS:
            value = f"{parameters[name]:g}" if name in parameters else "unknown"
            yield f"{name} is {value}, so that the vehicle would drive on in our silence; set it to {DISARMS:g}, disarm"
    if not 0.0 < parameters.get(name := "FS_PILOT_TIMEOUT", math.inf) <= LONGEST_PILOT_S:
        value = f"{parameters[name]:g} s" if name in parameters else "unknown"
        yield f"{name} is {value}, so long would the vehicle drive on unled; set it to {LONGEST_PILOT_S:g} or less"
    if other := another_pilot(heard):
        yield other
    if heard.named_values.get("InputHold"):  # sticks in the middle would not be neutral
        yield "the vehicle holds an input of its pilot (InputHold); ask for its release at the joystick"
    if (trim := parameters.get("RC4_TRIM", STICK_CENTRE)) != STICK_CENTRE:
        yield f"RC4_TRIM is {trim:g}, so that a stick in the middle turns the vehicle; set it to {STICK_CENTRE:g}"
    for name in ("ATTITUDE", "SERVO_OUTPUT_RAW"):
        rate, expected = heard.count[name] / seconds, MESSAGE_RATES[name][1]
        if rate < 0.4 * expected:
            remedy = "use a link that carries more, and check that the vehicle's estimator runs"
            yield f"{name} came {rate:.1f} times a second, and {expected:g} were asked for; {remedy}"
    outputs_are_known(heard)
    stick = Stick.of(heard)
    if stick.reach < output - 1.0 / STICK_CENTRE:
        more = output / max(stick.reach, 1e-3)
        gain = more * stick.gain
        mend = f"the gain to {gain:.3g}" if gain <= 1 else f"ACRO_YAW_P to {more * stick.yaw_p:.3g}"
        yield (
            f"a full stick gives {100 * stick.reach:.0f} % of the yaw output at the pilot gain {stick.gain:.2g} and "
            f"ACRO_YAW_P {stick.yaw_p:g}, and the campaign needs {100 * output:.0f} %; set {mend} or more, or "
            "make a plan with smaller moments"
        )


def _battery_and_depth(heard: Heard, campaign: LinkCampaign, number: int, depth_limit: float) -> Iterator[str]:
    battery = campaign.battery
    drawn = campaign.charge(number) - campaign.charge(len(campaign.runs))
    reserve = battery.charge_Ah * battery.reserve_percent / 100.0
    if heard.remaining_percent is None:
        yield "the vehicle does not tell how much its battery holds; set BATT_MONITOR and BATT_CAPACITY"
    elif (stock := battery.charge_Ah * heard.remaining_percent / 100.0) - drawn < reserve:
        yield (
            f"the battery holds {heard.remaining_percent:.0f} % or {stock:.2f} Ah by its own count; the campaign needs "
            f"{drawn:.2f} Ah, and {reserve:.2f} Ah must stay; charge it, and make a plan of what is left"
        )
    if depth_limit < math.inf and not heard.depth:  # who has no sensor says 0
        yield "the vehicle does not tell its depth; check its sensor, or leave out --depth-limit"
    elif heard.depth is not None and heard.depth > depth_limit:
        limit = f"--depth-limit is {depth_limit:g} m; bring it up, or give another limit"
        yield f"the vehicle is {heard.depth:.1f} m deep already, and {limit}"


def another_pilot(heard: Heard) -> str:
    """Return a sentence where somebody else sends sticks (the last wins), or is a ground station under our number,
    whose heartbeat would hide that ours is gone; else nothing."""
    for (system, component), packet in heard.senders.items():
        return (
            f"somebody else sends {packet} (system {system}, component {component}), and the last one wins; switch off "
            "the joystick there, or close that ground station, and try again"
        )
    for system, component in sorted(heard.stations):
        if system == STATION_ID[0]:
            return (
                f"another ground station has our number (system {system}, component {component}), and its heartbeat "
                "hides our silence; close it, or give it another number (QGroundControl: MAVLink System ID)"
            )
    return ""


def outputs_are_known(heard: Heard) -> Part:
    """How a yaw output is found in the pulses. Raises SettingError where the frame does not tell."""
    channels = {number: np.array([pulse]) for number, pulse in heard.pulses.items()}
    try:
        part = part_of("SERVO_OUTPUT_RAW", channels, heard.parameters)
    except Unclear as unclear:
        raise SettingError(
            f"no yaw output can be read in what the thrusters are sent: {str(unclear).partition(';')[0]}; use one of "
            "ArduSub's own frames (FRAME_CONFIG 0 to 6), and check SERVOn_FUNCTION of the motors"
        ) from None
    if not part.observable[0]:
        raise SettingError("no output of the vehicle turns it; check SERVOn_FUNCTION of its motors")
    return part
