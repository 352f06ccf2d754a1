"""A vehicle on a CAN bus: commands go out as frames of its DBC at a steady rate, the compass comes in the same way.

The column map that reads captures of the bus drives it: `[can] dbc` describes frames, `[columns]` names signals."""

import contextlib
import time
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automarine_cli.dofs import YAW
from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign, PlannedRun
from automarine_cli.link.vehicles.base import Halted, Pace, StuckError, in_time
from automarine_cli.logs import ColumnMap, ColumnRule, given_columns
from automarine_cli.logs.can import messages_of
from automarine_cli.logs.columns import CANONICAL, LABELS
from automarine_cli.logs.streams import needed
from automarine_cli.pipeline.records import Document, Source
from automarine_cli.planning.candidates import CommandTable, command_table, drive_of
from automarine_cli.thrusters.map import TwinThrusters, map_and_arm

BUS_LISTEN_S = 0.5  # before a run sends; `MAX_MUTE_S` to a compass that does not speak
MAX_MUTE_S = 2.0  # A compass that has not been heard of for so long is gone
NEUTRAL_FRAMES, NEUTRAL_PAUSE_S = 5, 0.1  # at the end of a run: a plug may be loose for a moment
SEND_S = 0.5  # A command that has not left after this is none any more
HEADINGS = tuple(name for name, column in CANONICAL.items() if column.quantity == YAW.position)


@dataclass(frozen=True)
class FrameStep:
    """From `at` [s since the log's start] on these frames are sent, which say `readings` in the log's columns."""

    at: float
    frames: tuple[Any, ...]
    readings: tuple[str, ...]


@dataclass(frozen=True)
class CanBus:
    """The bus `place` (python-can's INTERFACE:CHANNEL, with @BITRATE where needed), with the signals that `names`
    gives; `drive_by` makes commands of two thrusters of the moments."""

    place: str
    names: ColumnMap
    drive_by: TwinThrusters | None
    speed: float = 1.0

    @classmethod
    def of(
        cls, place: str, columns: Path | Document | ColumnMap | None, thrusters: Source | None, arm: float | None
    ) -> "CanBus":
        """The bus with the signals of a column map and the drive of a thruster map. Raises SettingError, ModelError."""
        names = given_columns(columns)
        levered = map_and_arm(thrusters, arm, names, YAW)
        return cls(place, names, levered and drive_of(*levered, most=None, equal_thrust=True))

    @property
    def messages(self) -> Mapping[str, Any]:
        if not self.names.dbc:
            remedy = 'give a column map with [can] dbc = "vehicle.dbc" (--columns)'
            raise SettingError(f"a CAN bus is driven by the DBC that describes it; {remedy}")
        return {message.name: message for message in messages_of(self.names)}

    def received(self) -> dict[str, ColumnRule]:
        """Our columns that come from the bus, a heading among them. Raises SettingError, LogError."""
        signals = {f"{message.name}.{signal.name}" for message in self.messages.values() for signal in message.signals}
        commanded = {name for name, column in CANONICAL.items() if column.quantity in (YAW.command, *YAW.thrusters)}
        rules = {
            name: rule for name, rule in self.names.columns.items()
            if name not in (*LABELS, *commanded) and rule.source in signals and rule.of_one
        }  # fmt: skip
        if not any(name in HEADINGS for name in rules):
            raise SettingError(
                "the column map names no signal of the DBC for the heading; write a line such as "
                'heading_deg = "Compass.Heading" under [columns]'
            )
        return rules

    def refuse(self, campaign: LinkCampaign) -> None:
        """Raise SettingError for commands that the frames cannot hold, and for a bus that cannot be opened."""
        if self.drive_by is not None and campaign.moment_unit == "nu":
            raise SettingError(
                "the campaign's moments are normalised (nu), and the thruster map makes N m; plan for a model in N m, "
                "or leave --thrusters out and name the signal of the moment, tau, in the column map"
            )
        if self.drive_by is not None and campaign.battery.at_moment > (most := self.drive_by.largest):
            mismatch = f"the campaign goes up to {campaign.battery.at_moment:g} N m, the thrusters give {most:.4g} N m"
            raise SettingError(f"{mismatch}; make the plan with the same --thrusters and --arm")
        self.received()
        for run in campaign.runs:
            self.steps(campaign, run)
        with self._opened():
            pass

    def steps(self, campaign: LinkCampaign, run: PlannedRun) -> list[FrameStep]:
        table, messages = self._table(campaign, run), self.messages
        return [_step(messages, table, at, table.held(values), run.name) for at, values in table.rows]

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        """The lines of a run's log, one for each heading that is received, with the commands in force."""
        run, begins = campaign.runs[number], campaign.begins(number)
        steps = self.steps(campaign, run)
        commands, ends = self._table(campaign, run).names, steps[-1].at
        with self._opened() as bus:
            ear = _Ear(self, bus, {frame.arbitration_id for step in steps for frame in step.frames})
            ear.listen(BUS_LISTEN_S / self.speed, MAX_MUTE_S / self.speed)
            if halted():
                return
            yield f"# Driven over CAN, {campaign.log_name(run)}; commands as sent.\n"
            yield f"{','.join(('time_s', *self.received(), *commands))}\n"
            pace, tick, now = Pace(self.speed), 0, steps[0]
            try:
                while (since := tick / campaign.rate_hz) <= ends and not halted():
                    if (late := -pace.left(since)) > MAX_MUTE_S / self.speed:  # what was missed is not sent in a burst
                        raise SettingError(f"the bus {self.place} hung for {late:.1f} s; look at its adapter")
                    now = next(step for step in reversed(steps) if step.at <= since + 1e-9)
                    bus.send(now)
                    tick += 1
                    while (wait := pace.left(min(tick / campaign.rate_hz, ends + 1e-9))) > 0:
                        if (heard := ear.heard(wait)) is not None:
                            yield f"{begins + pace.passed:.3f},{heard},{','.join(now.readings)}\n"
                    ear.refuse_silence(MAX_MUTE_S / self.speed)
            finally:
                bus.rest(steps[0], NEUTRAL_PAUSE_S / self.speed)
            if halted() and ear.last:
                yield f"{begins + pace.passed:.3f},{ear.last},{','.join(steps[0].readings)}\n"

    def _table(self, campaign: LinkCampaign, run: PlannedRun) -> CommandTable:
        return command_table(run.candidate, campaign.rest_s, campaign.moment_unit, self.drive_by, self.names)

    @contextlib.contextmanager
    def _opened(self) -> Iterator["_Bus"]:
        kind, _, address = self.place.partition(":")
        channel, _, bitrate = address.partition("@")
        if not kind or not channel or (bitrate and not bitrate.isdigit()):
            such = "such as socketcan:can0 or slcan:/dev/ttyACM0@500000"
            raise SettingError(f"found the bus {self.place!r}; give python-can's INTERFACE:CHANNEL, {such}")
        try:
            bus = _library().Bus(interface=kind, channel=channel, **({"bitrate": int(bitrate)} if bitrate else {}))
        except Exception as problem:  # each interface raises its own
            why = f"{str(problem).partition(chr(10))[0]}); look at the adapter and its settings"
            raise SettingError(f"the bus {self.place} cannot be opened ({why}") from None
        with contextlib.closing(_Bus(f"the bus {self.place}", bus)) as opened:
            yield opened


class _Bus:
    """A bus of python-can, of any interface: its trouble is a SettingError, and commands leave in time or never."""

    def __init__(self, name: str, bus: Any) -> None:
        self._name, self._bus, self._stuck = name, bus, ""

    def send(self, step: FrameStep) -> None:
        """Send the frames of a step. Raises SettingError, and StuckError from the first time on that it hangs."""
        if self._stuck:
            raise StuckError(self._stuck)
        try:
            with self._trouble():
                in_time(lambda: [self._bus.send(frame, SEND_S) for frame in step.frames], 2 * SEND_S, self._name)
        except StuckError as hangs:
            self._stuck = str(hangs)
            raise

    def rest(self, neutral: FrameStep, pause: float) -> None:
        """Send neutral several times; one that fails keeps no other from being sent. Raises what the last raises."""
        for remaining in reversed(range(NEUTRAL_FRAMES)):
            try:
                self.send(neutral)
            except SettingError:
                if not remaining or self._stuck:
                    raise
            time.sleep(pause)

    def recv(self, seconds: float) -> Any:
        with self._trouble():
            return self._bus.recv(seconds)

    def close(self) -> None:
        with self._trouble():
            in_time(self._bus.shutdown, 2 * SEND_S, self._name)

    @contextlib.contextmanager
    def _trouble(self) -> Iterator[None]:
        try:
            yield
        except StuckError:
            raise
        except Exception as problem:  # each interface raises its own
            why = f"{type(problem).__name__}: {problem}".rstrip(": ")
            raise SettingError(f"{self._name} failed ({why}); look at its cable and adapter") from None


def _step(messages: Mapping[str, Any], table: CommandTable, at: float, values: list[float], run: str) -> FrameStep:
    """The frames of one set of values, and what they say when they are read back. Raises SettingError."""
    by_message: dict[str, dict[str, float]] = {}
    for rule, value in zip(table.rules, values):
        name, _, signal = rule.source.partition(".")
        by_message.setdefault(name, {})[signal] = value
    frames, sent = [], dict[str, float]()
    for name, signals in by_message.items():
        message = _message(messages, name, signals)
        initialised = {signal.name: signal.initial for signal in message.signals} | signals
        try:
            data = message.encode(initialised)
        except Exception as problem:  # cantools raises errors of its own and of bitstruct
            raise SettingError(f"run {run}: {problem}; plan smaller moments, or correct the column map") from None
        decoded, wide = message.decode(data, False), message.is_extended_frame
        sent |= {f"{name}.{signal}": float(decoded[signal]) for signal in signals}
        frames.append(_library().Message(arbitration_id=message.frame_id, is_extended_id=wide, data=data))
    readings = (f"{rule.read(sent[rule.source], factor):.6g}" for rule, factor in zip(table.rules, table.factors))
    return FrameStep(at, tuple(frames), tuple(readings))


def _message(messages: Mapping[str, Any], name: str, signals: Mapping[str, float]) -> Any:
    """The message that holds the signals. Raises SettingError where the DBC leaves open what else it says."""
    message = messages.get(name)
    names = [] if message is None else [signal.name for signal in message.signals]
    if missing := [signal for signal in signals if signal not in names]:
        raise SettingError(
            f"the DBC holds no signal {f'{name}.{missing[0]}'.rstrip('.')}; name the signal of each command in the "
            'column map, such as tau = "Thrusters.Moment" under [columns]'
        )
    assert message is not None
    if message.is_multiplexed():
        remedy = "name a signal of another message in the column map"
        raise SettingError(f"{name} is multiplexed, and such commands are not sent; {remedy}")
    if unset := [signal.name for signal in message.signals if signal.name not in signals and signal.initial is None]:
        remedy = "add it to the DBC (GenSigStartValue), so that it is known what is sent"
        raise SettingError(f"{name} also holds {unset[0]}, for which the DBC gives no start value; {remedy}")
    return message


class _Ear:
    def __init__(self, vehicle: CanBus, bus: "_Bus", driven_ids: set[int]) -> None:
        self._bus, self._driven_ids, self._rules = bus, driven_ids, vehicle.received()
        self._values = dict.fromkeys(self._rules, "")
        names = {rule.source.partition(".")[0] for rule in self._rules.values()}
        self._messages = {message.frame_id: message for name, message in vehicle.messages.items() if name in names}
        self._when = time.monotonic()

    @property
    def last(self) -> str:
        """The last values, as a log shows them; empty before a heading came."""
        speaks = any(value for name, value in self._values.items() if name in HEADINGS)
        return ",".join(self._values.values()) if speaks else ""

    def listen(self, seconds: float, patience: float) -> None:
        """Hear for `seconds`, longer for a first heading. Raises SettingError for a second sender, a mute compass."""
        begun = time.monotonic()
        while (wait := begun + (seconds if self.last else max(seconds, patience)) - time.monotonic()) > 0:
            self.heard(wait)
        if not self.last:
            raise SettingError("no heading came from the bus; look at the compass, the bit rate and the column map")

    def heard(self, seconds: float) -> str | None:
        """The next values, if they come with a heading, in so long at most. Raises SettingError for a second sender."""
        frame = self._bus.recv(seconds)
        if frame is None:
            return None
        if frame.arbitration_id in self._driven_ids:
            raise SettingError(
                f"somebody else sends 0x{frame.arbitration_id:x}, by which the run is driven; make that sender stop"
            )
        message = self._messages.get(frame.arbitration_id)
        if message is None or frame.is_error_frame or len(frame.data) < message.length:
            return None
        values = {f"{message.name}.{signal}": value for signal, value in message.decode(frame.data, False).items()}
        heard = {name: rule for name, rule in self._rules.items() if rule.source in values}
        for name, rule in heard.items():
            factor = CANONICAL[name].factor(rule.unit) / CANONICAL[name].factor()
            self._values[name] = f"{rule.read(float(values[rule.source]), factor):.6g}"
        if not any(name in HEADINGS for name in heard):
            return None
        self._when = time.monotonic()
        return self.last

    def refuse_silence(self, seconds: float) -> None:
        if time.monotonic() - self._when > seconds:
            raise SettingError("the compass fell silent; look at it before the next campaign")


def _library() -> Any:
    return needed("can", "can", "--vehicle can", "CAN buses")
