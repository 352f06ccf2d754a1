"""What must be so before ArduSub is armed: each check is a function with its sentence."""

import math
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
        """From run `number` on."""
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
    is_a_submarine(link.heard)
    for number, rate in RATES.values():
        link.command(SET_MESSAGE_INTERVAL, number, 1e6 / rate)
    link.heard.count.clear()
    begun = link.now()
    for _ in range(ROUNDS):
        link.ask(name for name in PARAMETERS if name not in link.heard.parameters)
        link.wait(LISTEN_S / ROUNDS)
    link.wait(NAMED_S, lambda: "PilotGain" in link.heard.named)
    heard = link.heard
    for check in (is_disarmed, hears_us, has_a_dead_man, has_no_other_pilot, holds_no_input, has_its_middle):
        check(heard)
    answers_often(heard, link.now() - begun)
    stick, part = Stick.of(heard), outputs_are_known(heard)
    reaches(stick, need)
    has_charge(heard, need)
    knows_its_depth(heard, need)
    return stick, part


def is_a_submarine(heard: Heard) -> None:
    """Raise SettingError for another autopilot or vehicle."""
    if (heard.autopilot, heard.kind) != (ARDUPILOT, SUBMARINE):
        raise SettingError(
            f"the autopilot is MAV_AUTOPILOT {heard.autopilot} in a MAV_TYPE {heard.kind}, expected {ARDUPILOT} and "
            f"{SUBMARINE} of ArduSub; check --mavlink"
        )


def is_disarmed(heard: Heard) -> None:
    """Raise SettingError where somebody has armed it."""
    if heard.armed:
        raise SettingError("the vehicle is armed already, so somebody else drives it; make them disarm it")


def hears_us(heard: Heard) -> None:
    """Raise SettingError where it takes sticks from other ground stations only: it would pass ours over in silence."""
    known = heard.parameters
    name = "MAV_GCS_SYSID" if "MAV_GCS_SYSID" in known else "SYSID_MYGCS"
    if name not in known:
        raise SettingError(
            "the vehicle tells no parameters, without which it is not driven; check the link, and start it again"
        )
    first = known[name]
    if not first <= OURS[0] <= max(first, known.get("MAV_GCS_SYSID_HI", 0.0)):
        raise SettingError(
            f"{name} is {first:g}, and the vehicle takes sticks from that system only; set it to {OURS[0]}, which we "
            "send as, or say so on the other ground station and leave it out"
        )


def has_a_dead_man(heard: Heard) -> None:
    """Raise SettingError where the vehicle would drive on when we fall silent."""
    known = heard.parameters
    for name in ("FS_PILOT_INPUT", "FS_GCS_ENABLE"):
        if known.get(name) != DISARMS:
            told = f"{known[name]:g}" if name in known else "unknown"
            raise SettingError(
                f"{name} is {told}, so that the vehicle would drive on when we fall silent; set it to {DISARMS:g}, "
                "which disarms it"
            )
    if not 0.0 < known.get(name := "FS_PILOT_TIMEOUT", math.inf) <= LONGEST_PILOT_S:
        told = f"{known[name]:g} s" if name in known else "unknown"
        raise SettingError(
            f"{name} is {told}, so long would the vehicle drive on when we fall silent; set it to {LONGEST_PILOT_S:g} "
            "or less"
        )


def has_no_other_pilot(heard: Heard) -> None:
    """Raise SettingError where somebody else sends sticks, or is a ground station under our number.

    The last stick wins, and such a station's heartbeat would keep the vehicle from noticing that ours is gone.
    """
    if heard.senders:
        (system, component), what = next(iter(heard.senders.items()))
        raise SettingError(
            f"somebody else sends {what} (system {system}, component {component}), and the last one wins; switch off "
            "the joystick there, or close that ground station, and try again"
        )
    if found := [component for system, component in sorted(heard.stations) if system == OURS[0]]:
        raise SettingError(
            f"another ground station has our number (system {OURS[0]}, component {found[0]}), and its heartbeat hides "
            "that we fell silent; close it, or give it another number to look on (QGroundControl: MAVLink System ID)"
        )


def holds_no_input(heard: Heard) -> None:
    """Raise SettingError where a pilot told it to hold an input: sticks in the middle would not be neutral."""
    if heard.named.get("InputHold"):
        raise SettingError("the vehicle holds an input of its pilot (InputHold); ask for its release at the joystick")


def has_its_middle(heard: Heard) -> None:
    """Raise SettingError where a stick in the middle is no neutral yaw."""
    if (found := heard.parameters.get("RC4_TRIM", CENTRE)) != CENTRE:
        raise SettingError(
            f"RC4_TRIM is {found:g}, so that a stick in the middle turns the vehicle; set it to {CENTRE:g}"
        )


def answers_often(heard: Heard, seconds: float) -> None:
    """Raise SettingError where attitude or outputs come too rarely to make a log of."""
    for name in ("ATTITUDE", "SERVO_OUTPUT_RAW"):
        found, asked = heard.count[name] / seconds, RATES[name][1]
        if found < 0.4 * asked:
            raise SettingError(
                f"{name} came {found:.1f} times a second, and {asked:g} were asked for; use a link that carries more, "
                "and check that the vehicle's estimator runs"
            )


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


def reaches(stick: Stick, need: Need) -> None:
    """Raise SettingError where the pilot gain keeps the sticks from the largest output."""
    if stick.reach < need.output - 1.0 / CENTRE:
        more = need.output / stick.reach
        mend = (
            f"the gain to {gain:.3g}" if (gain := more * stick.gain) <= 1 else f"ACRO_YAW_P to {more * stick.yaw_p:.3g}"
        )
        raise SettingError(
            f"a full stick gives {100 * stick.reach:.0f} % of the yaw output at the pilot gain {stick.gain:.2g} and "
            f"ACRO_YAW_P {stick.yaw_p:g}, and the campaign needs {100 * need.output:.0f} %; set {mend} or more, or "
            "make a plan with smaller moments"
        )


def has_charge(heard: Heard, need: Need) -> None:
    """Raise SettingError where the battery does not carry the rest of the campaign, by its own count."""
    if heard.remaining_percent is None:
        raise SettingError(
            "the vehicle does not tell how much its battery holds; set BATT_MONITOR and BATT_CAPACITY, as without "
            "these nobody knows whether the campaign can be driven to its end"
        )
    left = need.charge * heard.remaining_percent / 100.0
    if left - need.drawn < need.reserve:
        raise SettingError(
            f"the battery holds {heard.remaining_percent:.0f} % or {left:.2f} Ah by its own count; the campaign needs "
            f"{need.drawn:.2f} Ah, and {need.reserve:.2f} Ah must stay; charge it, and make a plan of what is left"
        )


def knows_its_depth(heard: Heard, need: Need) -> None:
    """Raise SettingError where a depth limit cannot be watched, or is passed already."""
    if need.depth_limit == math.inf:
        return
    if not heard.depth:  # who has no sensor says 0
        raise SettingError("the vehicle does not tell its depth; check its sensor, or leave out --depth-limit")
    if heard.depth > need.depth_limit:
        raise SettingError(
            f"the vehicle is {heard.depth:.1f} m deep already, and --depth-limit is {need.depth_limit:g} m; bring it "
            "up, or give another limit"
        )
