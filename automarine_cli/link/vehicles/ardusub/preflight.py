"""What must be so before ArduSub is armed: each rule with its sentence."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.ardusub.packets import OURS, Heard, Link
from automarine_cli.link.vehicles.ardusub.sticks import CENTRE, Authority, Stick
from automarine_cli.logs.mixing import Part, Unclear, part_of

ARDUPILOT, SUBMARINE = 3, 12  # MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_TYPE_SUBMARINE
SET_MESSAGE_INTERVAL = 511
RATES = {
    "ATTITUDE": (30, 25.0), "SERVO_OUTPUT_RAW": (36, 50.0), "VFR_HUD": (74, 5.0), "GLOBAL_POSITION_INT": (33, 5.0),
    "SYS_STATUS": (1, 2.0),
}  # fmt: skip
"""Messages that are asked for: their number, and how often a second."""
NAMED_S = 5.0
FIRST_S, LISTEN_S, ROUNDS = 5.0, 3.0, 6
DISARMS = 2.0
LONGEST_PILOT_S = 3.0
PARAMETERS = (
    "FS_PILOT_INPUT", "FS_PILOT_TIMEOUT", "FS_GCS_ENABLE", "SYSID_MYGCS", "MAV_GCS_SYSID", "MAV_GCS_SYSID_HI",
    "JS_GAIN_DEFAULT", "ACRO_YAW_P", "RC4_MIN", "RC4_TRIM", "RC4_MAX", "RC4_DZ", "RC4_REVERSED", "FRAME_CONFIG",
    *(f"SERVO{n}_FUNCTION" for n in range(1, 17)), *(f"MOT_{n}_DIRECTION" for n in range(1, 9)),
)  # fmt: skip


@dataclass(frozen=True)
class Need:
    """What the rest of a campaign needs: the largest `output`, charge [Ah] of a battery that holds `charge` and must
    keep `reserve`, and `depth_limit` [m]."""

    output: float
    drawn: float
    charge: float
    reserve: float
    depth_limit: float

    @classmethod
    def of(cls, campaign: LinkCampaign, number: int, authority: Authority, depth_limit: float) -> "Need":
        asked = (abs(authority.output(moment)) for run in campaign.runs[number:] for moment, _ in run.commands)
        charge = campaign.battery.charge_Ah
        drawn = campaign.left(number) - campaign.left(len(campaign.runs))
        return cls(max(asked), drawn, charge, charge * campaign.battery.reserve_percent / 100.0, depth_limit)


def preflight(link: Link, need: Need) -> tuple[Stick, Part]:
    """How the sticks work, and how the outputs are read, of a vehicle that may be armed. Raises SettingError."""
    if not link.wait(FIRST_S, lambda: "HEARTBEAT" in link.heard.last):
        raise SettingError(
            f"no autopilot was heard on {link.address} in {FIRST_S:g} s; check --mavlink, and where the vehicle sends"
        )
    heard = link.heard
    if (heard.autopilot, heard.kind) != (ARDUPILOT, SUBMARINE):
        raise SettingError(
            f"the autopilot is MAV_AUTOPILOT {heard.autopilot} in a MAV_TYPE {heard.kind}, expected {ARDUPILOT} and "
            f"{SUBMARINE} of ArduSub; check --mavlink"
        )
    for number, rate in RATES.values():
        link.command(SET_MESSAGE_INTERVAL, number, 1e6 / rate)
    heard.count.clear()
    begun = link.now()
    for _ in range(ROUNDS):
        link.ask(name for name in PARAMETERS if name not in heard.parameters)
        link.wait(LISTEN_S / ROUNDS)
    link.wait(NAMED_S, lambda: "PilotGain" in heard.named)
    for why in complaints(heard, need, link.now() - begun):
        raise SettingError(why)
    return Stick.of(heard), outputs_are_known(heard)


def complaints(heard: Heard, need: Need, seconds: float) -> Iterator[str]:
    """Yield a sentence for each rule that a vehicle breaks which was listened to for so long. Raises SettingError where
    its frame does not tell the yaw output."""
    known = heard.parameters
    if heard.armed:
        yield "the vehicle is armed already, so somebody else drives it; make them disarm it"
    # one that takes sticks from other ground stations only would pass ours over in silence
    name = "MAV_GCS_SYSID" if "MAV_GCS_SYSID" in known else "SYSID_MYGCS"
    if name not in known:
        yield "the vehicle tells no parameters, without which it is not driven; check the link, and start it again"
    elif not known[name] <= OURS[0] <= max(known[name], known.get("MAV_GCS_SYSID_HI", 0.0)):
        yield (
            f"{name} is {known[name]:g}, and the vehicle takes sticks from that system only; set it to {OURS[0]}, "
            "which we send as, or say so on the other ground station and leave it out"
        )
    for name in ("FS_PILOT_INPUT", "FS_GCS_ENABLE"):
        if known.get(name) != DISARMS:
            value = f"{known[name]:g}" if name in known else "unknown"
            yield (
                f"{name} is {value}, so that the vehicle would drive on when we fall silent; set it to {DISARMS:g}, "
                "which disarms it"
            )
    if not 0.0 < known.get(name := "FS_PILOT_TIMEOUT", math.inf) <= LONGEST_PILOT_S:
        value = f"{known[name]:g} s" if name in known else "unknown"
        yield (
            f"{name} is {value}, so long would the vehicle drive on when we fall silent; set it to {LONGEST_PILOT_S:g} "
            "or less"
        )
    if other := another_pilot(heard):
        yield other
    if heard.named.get("InputHold"):  # sticks in the middle would not be neutral
        yield "the vehicle holds an input of its pilot (InputHold); ask for its release at the joystick"
    if (trim := known.get("RC4_TRIM", CENTRE)) != CENTRE:
        yield f"RC4_TRIM is {trim:g}, so that a stick in the middle turns the vehicle; set it to {CENTRE:g}"
    for name in ("ATTITUDE", "SERVO_OUTPUT_RAW"):
        rate, wanted = heard.count[name] / seconds, RATES[name][1]
        if rate < 0.4 * wanted:
            yield (
                f"{name} came {rate:.1f} times a second, and {wanted:g} were asked for; use a link that carries more, "
                "and check that the vehicle's estimator runs"
            )
    outputs_are_known(heard)
    stick = Stick.of(heard)
    if stick.reach < need.output - 1.0 / CENTRE:
        more = need.output / stick.reach
        gain = more * stick.gain
        mend = f"the gain to {gain:.3g}" if gain <= 1 else f"ACRO_YAW_P to {more * stick.yaw_p:.3g}"
        yield (
            f"a full stick gives {100 * stick.reach:.0f} % of the yaw output at the pilot gain {stick.gain:.2g} and "
            f"ACRO_YAW_P {stick.yaw_p:g}, and the campaign needs {100 * need.output:.0f} %; set {mend} or more, or "
            "make a plan with smaller moments"
        )
    if heard.remaining_percent is None:
        yield (
            "the vehicle does not tell how much its battery holds; set BATT_MONITOR and BATT_CAPACITY, as without "
            "these nobody knows whether the campaign can be driven to its end"
        )
    elif (left := need.charge * heard.remaining_percent / 100.0) - need.drawn < need.reserve:
        yield (
            f"the battery holds {heard.remaining_percent:.0f} % or {left:.2f} Ah by its own count; the campaign needs "
            f"{need.drawn:.2f} Ah, and {need.reserve:.2f} Ah must stay; charge it, and make a plan of what is left"
        )
    if need.depth_limit < math.inf and not heard.depth:  # who has no sensor says 0
        yield "the vehicle does not tell its depth; check its sensor, or leave out --depth-limit"
    elif heard.depth is not None and heard.depth > need.depth_limit:
        yield (
            f"the vehicle is {heard.depth:.1f} m deep already, and --depth-limit is {need.depth_limit:g} m; bring it "
            "up, or give another limit"
        )


def another_pilot(heard: Heard) -> str:
    """Return a sentence where somebody else sends sticks, or is a ground station under our number; else nothing.

    The last stick wins, and such a station's heartbeat would keep the vehicle from noticing that ours is gone.
    """
    for (system, component), what in heard.senders.items():
        return (
            f"somebody else sends {what} (system {system}, component {component}), and the last one wins; switch off "
            "the joystick there, or close that ground station, and try again"
        )
    for system, component in sorted(heard.stations):
        if system == OURS[0]:
            return (
                f"another ground station has our number (system {system}, component {component}), and its heartbeat "
                "hides that we fell silent; close it, or give it another number to look on (QGroundControl: MAVLink "
                "System ID)"
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
    if not part.found[0]:
        raise SettingError("no output of the vehicle turns it; check SERVOn_FUNCTION of its motors")
    return part
