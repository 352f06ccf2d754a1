"""A vehicle on python-can's virtual bus: thrusters that hear frames of a DBC, and a compass that answers."""

import contextlib
import math
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import can
import cantools
from can.interfaces.virtual import VirtualBus

DBC = """VERSION ""
NS_ :
BS_:
BU_: Vehicle
BO_ 291 Compass: 4 Vehicle
 SG_ Heading : 0|16@1+ (0.01,0) [0|360] "deg" Vehicle
 SG_ YawRate : 16|16@1- (0.01,0) [-300|300] "deg/s" Vehicle
BO_ 292 Drive: 4 Vehicle
 SG_ Moment : 7|16@0- (0.001,0) [-2|2] "nu" Vehicle
 SG_ Depth : 16|16@1- (0.001,0) [-30|30] "m" Vehicle
BO_ 293 Pulses: 4 Vehicle
 SG_ Port : 0|16@1+ (1,0) [1100|1900] "us" Vehicle
 SG_ Stbd : 16|16@1+ (1,0) [1100|1900] "us" Vehicle
BO_ 294 Open: 4 Vehicle
 SG_ Moment : 0|16@1- (0.001,0) [-2|2] "nu" Vehicle
 SG_ Lamp : 16|8@1+ (1,0) [0|1] "" Vehicle
BA_DEF_ SG_ "GenSigStartValue" FLOAT -100000 100000;
BA_DEF_DEF_ "GenSigStartValue" 0;
BA_ "GenSigStartValue" SG_ 292 Depth 500;
"""
COLUMNS = '[can]\ndbc = "bus.dbc"\n[columns]\nheading_deg = "Compass.Heading"\nyaw_rate_deg_s = "Compass.YawRate"\n'
MOMENT = COLUMNS + 'tau = "Drive.Moment"\n'
PULSES = COLUMNS + "\n".join(
    f'{name} = {{ from = "Pulses.{side}", subtract = 1500, scale = 0.25 }}'
    for name, side in (("n_port", "Port"), ("n_stbd", "Stbd"))
)  # fmt: skip


def column_map(folder: Path, text: str = MOMENT) -> Path:
    """A column map as a file, its DBC beside it."""
    (folder / "bus.dbc").write_text(DBC)
    (folder / "columns.toml").write_text(text)
    return folder / "columns.toml"


class FaultyBus(VirtualBus):
    """An interface of python-can whose calls do what `faults` has for them first; commands that left are `sent`."""

    faults: ClassVar[dict[str, Callable[["FaultyBus"], object]]] = {}
    sent: ClassVar[list[float]] = []
    last: ClassVar[list["FaultyBus"]] = []

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.is_down = threading.Event()
        self.last[:] = [self]

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._fail("send")
        self.sent.append(time.monotonic())
        super().send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._fail("recv")
        return super()._recv_internal(timeout)

    def shutdown(self) -> None:
        self.is_down.set()
        super().shutdown()
        self._fail("shutdown")

    def _fail(self, call: str) -> None:
        if call in self.faults:
            self.faults[call](self)


@dataclass
class Vessel:
    """I_r r' = tau - k r|r| with I_r = `inertia` and k = `drag`; what it heard, with the times; what it is to do."""

    speed: float
    inertia: float = 1.0
    drag: float = 1.25
    channel: str = field(default_factory=lambda: f"bus-{uuid.uuid4()}")
    heard: list[tuple[float, int, dict[str, float]]] = field(default_factory=list)
    speaks: bool = True
    intrudes: bool = False
    _alive: bool = True

    @contextlib.contextmanager
    def afloat(self) -> Iterator["Vessel"]:
        """It lives on its bus as long as the block lasts."""
        bus = can.Bus(interface="virtual", channel=self.channel)
        thread = threading.Thread(target=self._live, args=(bus,))
        thread.start()
        try:
            yield self
        finally:
            self._alive = False
            thread.join()
            bus.shutdown()

    def moments(self) -> list[float]:
        """The moments that it heard, in order."""
        return [values["Moment"] for _, _, values in self.heard]

    def _live(self, bus: Any) -> None:
        known: Any = cantools.database.load_string(DBC, "dbc")
        messages = {one.frame_id: one for one in known.messages}
        psi = rate = tau = 0.0
        last = spoke = time.monotonic()
        while self._alive:
            frame = bus.recv(0.002)
            now = time.monotonic()
            for _ in range(20):
                rate += (tau - self.drag * rate * abs(rate)) / self.inertia * (now - last) * self.speed / 20
                psi += rate * (now - last) * self.speed / 20
            last = now
            if frame is not None:
                values = messages[frame.arbitration_id].decode(frame.data)
                self.heard.append((now, frame.arbitration_id, values))
                tau = values.get("Moment", tau)
            if self.speaks and (now - spoke) * self.speed >= 0.05:
                spoke = now
                said = {"Heading": math.degrees(psi) % 360.0 % 359.995, "YawRate": math.degrees(rate)}
                bus.send(can.Message(arbitration_id=291, data=messages[291].encode(said), is_extended_id=False))
            if self.intrudes:
                self.intrudes = False
                data = messages[292].encode({"Moment": 0.0, "Depth": 0.0})
                bus.send(can.Message(arbitration_id=292, data=data, is_extended_id=False))
