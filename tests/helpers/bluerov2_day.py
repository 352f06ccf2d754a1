"""What a BlueROV2's owner has before the first campaign: the telemetry log of a dive, and what the pool allows."""

import struct
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path

import numpy as np
from fake_ardusub import FakeSub, Station

BEGAN_S = 1.75e9  # by the ground station's clock
STICKS = (-1000, -700, -450, -250, 250, 450, 700, 1000)
POOL = """schema = "automarine/plan-limits/1"
[pool]
minutes = 12
runs = 12
wait_s = 10
[moments]
largest = 0.45                # of the whole yaw output; a pilot gain of 0.5 gives no more than 0.5
[goal]
use_earlier_runs = false
"""


@dataclass
class Recorded(FakeSub):
    """A vehicle whose packets a ground station keeps."""

    log: BufferedWriter | None = None

    def write(self, data: bytes) -> None:
        """Keep a packet as a .tlog does, with the time in microseconds before it."""
        if self.log is not None:
            self.log.write(struct.pack(">Q", int((BEGAN_S + self.time) * 1e6)) + data)
        super().write(data)


def write_bluerov2_day(folder: Path, seed: int = 3) -> Path:
    """`dive.tlog`, two and a half minutes of turning to and fro by hand, and `pool.toml`; returns the folder."""
    folder.mkdir(parents=True)
    (folder / "pool.toml").write_text(POOL, encoding="utf-8")
    drawn = np.random.default_rng(seed)
    with (folder / "dive.tlog").open("wb") as log:
        vehicle = Recorded(gain=0.5, depth=1.0, log=log)
        for name, value in vehicle.parameters.items():
            vehicle._mav.param_value_send(name.encode(), value, 9, 100, 0)
        vehicle._every |= {30: 0.1, 36: 0.1, 33: 0.2}
        pilot = Station(vehicle)
        vehicle.advance(1.0)
        vehicle.armed = True
        for stick in drawn.permutation(STICKS * 2):
            for pushed in (int(stick), 0):
                ends = vehicle.time + drawn.uniform(3.0, 6.0)
                while vehicle.time < ends:
                    pilot.beat()
                    pilot.mav.manual_control_send(1, 0, 0, 500, pushed, 0)
                    vehicle.advance(0.1)
        vehicle.armed = False
        vehicle.advance(1.0)
    return folder
