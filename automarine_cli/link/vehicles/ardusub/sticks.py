"""What ArduSub makes of a yaw stick, and what a moment asks of its output."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automarine_cli.control.knowledge import turning
from automarine_cli.control.vehicles import Bend
from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.ardusub.packets import Heard
from automarine_cli.link.vehicles.base import refuse_beyond
from automarine_cli.thrusters.map import ThrusterMap

CENTRE, SPAN = 1500.0, 0.4
"""Of the pulse that a stick becomes [us]: its middle, and what each thousandth adds at a gain of 1."""
USUAL = 3.375
"""The ACRO_YAW_P at which a whole pulse is the whole output in MANUAL."""
ANGLE_DEG = 45.0
"""A whole pulse in STABILIZE; times ACRO_YAW_P it is a turn rate [deg/s]."""
MOST = 1000


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
        told = heard.parameters
        centre = told.get("RC4_TRIM", CENTRE)
        return cls(
            heard.named.get("PilotGain", told.get("JS_GAIN_DEFAULT", 0.5)),
            told.get("ACRO_YAW_P", USUAL),
            centre - told.get("RC4_MIN", 1100.0),
            told.get("RC4_MAX", 1900.0) - centre,
            -1.0 if told.get("RC4_REVERSED", 0.0) else 1.0,
            told.get("RC4_DZ", 40.0),
        )

    @property
    def reach(self) -> float:
        """The largest output, from 0 to 1, to whichever side it is less."""
        return min(abs(self.output(MOST)), abs(self.output(-MOST)))

    def output(self, yaw: int) -> float:
        off = int(CENTRE + yaw * SPAN * self.gain) - CENTRE
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
        return int(np.clip(round(np.copysign(off, signed) / (SPAN * self.gain)), -MOST, MOST))


@dataclass(frozen=True)
class Authority:
    """What the whole output gives, `full` in the campaign's unit, and how the moment grows with the output."""

    full: float
    bend: Bend | None = None

    def output(self, moment: float) -> float:
        share = moment / self.full
        return share if self.bend is None else float(self.bend.inverse(np.array(share)))

    def moment(self, output: float) -> float:
        return self.full * (output if self.bend is None else float(self.bend.of(np.array(output))))


def authority(campaign: LinkCampaign, full: float | None, thrusters: Path | None, arm: float | None) -> Authority:
    """What outputs give for a campaign; where nothing else is said the whole output is 1 nu. Raises SettingError."""
    bend, most = (None, None) if thrusters is None or arm is None else turning(ThrusterMap.load(thrusters), arm)
    unit = campaign.moment_unit
    if full is None:
        full = 1.0 if unit == "nu" else most
    if full is None:
        raise SettingError(
            "the campaign's moments are in N m, and ArduSub commands outputs from -1 to 1; give --full with the moment "
            "[N m] of the whole output, or --thrusters MAP.json and --arm METRES"
        )
    refuse_beyond(campaign, full)
    return Authority(full, bend)
