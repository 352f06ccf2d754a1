"""Battery, thrusters and command files: charge by hand, the map inverted, consumption recovered, what is refused."""

import csv
import io

import numpy as np
import pytest

from automarine_cli.errors import RunError, SettingError
from automarine_cli.logs import ColumnMap, ColumnRule
from automarine_cli.planning.candidates import (
    BatteryLimits,
    Limits,
    PaperRun,
    Pool,
    Supply,
    allowance,
    command_file,
    consumption,
    costs,
    drive_of,
    in_words,
    scheduled,
)
from automarine_cli.thrusters.bollard_data import Series
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap

SUPPLY = Supply(idle=0.3, full=6.0, largest=1.0)
STEP = PaperRun("step", "step", ((1.0, 4.0),))
SOFT = PaperRun("step", "soft", ((-0.25, 8.0),))
LIMITS = Limits(pool=Pool(minutes=10, runs=6, wait_s=57), battery=BatteryLimits(charge_Ah=2.0, reserve_percent=25))
MAP = ThrusterMap("square", PowerCurve(2.6165e-4), PowerCurve(0.6640e-4))


def test_costs_are_minutes_runs_motion_and_charge() -> None:
    """4 s at full moment and 60 s in all: (0.3·64 + 6·4)/3600 Ah; a quarter of the moment takes an eighth more."""
    assert SUPPLY.drawn(STEP, at_rest=60.0) == pytest.approx((0.3 * 64 + 6.0 * 4) / 3600.0, rel=1e-12)
    assert SUPPLY.drawn(SOFT, at_rest=0.0) == pytest.approx((0.3 * 8 + 6.0 / 8.0 * 8) / 3600.0, rel=1e-12)
    row = costs([STEP], LIMITS, SUPPLY)[0]
    assert row == pytest.approx([64.0 / 60.0, 1.0, 4.0, SUPPLY.drawn(STEP, 60.0)], rel=1e-12)
    assert allowance(LIMITS) == pytest.approx([10 + 57 / 60, 6, np.inf, 1.5])


def test_the_battery_after_each_run_is_what_was_drawn_until_then() -> None:
    slots = scheduled([STEP, SOFT, STEP], LIMITS, SUPPLY)
    spent = np.cumsum([SUPPLY.drawn(run, 3.0) for run in (STEP, SOFT, STEP)])
    waits = 0.3 * 57 / 3600.0 * np.arange(3)
    assert [slot.left for slot in slots] == pytest.approx(2.0 - spent - waits, rel=1e-12)
    assert [slot.begins for slot in slots] == [0.0, 64.0, 132.0] and slots[-1].ends(3.0) == pytest.approx(139.0)
    assert [slot.candidate.start_heading for slot in slots] == [0.0, 90.0, 180.0]


@pytest.mark.parametrize("equal_thrust", [True, False])
@pytest.mark.parametrize("moment", [0.3, -0.3])
def test_commands_give_the_moment_through_the_map(equal_thrust: bool, moment: float) -> None:
    drive = drive_of(MAP, 0.11 / 0.36, 150.0, equal_thrust)
    moment *= drive.largest / 0.36
    port, starboard = drive.commands(moment)
    assert 0.11 * float(MAP.force(port) - MAP.force(starboard)) == pytest.approx(0.36 * moment, rel=1e-9)
    assert np.sign(port) == np.sign(moment) == -np.sign(starboard)
    if equal_thrust:
        assert float(MAP.force(port) + MAP.force(starboard)) == pytest.approx(0.0, abs=1e-9)
    else:
        assert port == -starboard
    assert max(abs(n) for n in drive.commands(drive.largest)) == pytest.approx(150.0, rel=1e-5)


def test_a_map_of_one_direction_and_an_unknown_end_are_refused() -> None:
    with pytest.raises(SettingError, match="no backward direction"):
        drive_of(ThrusterMap("square", PowerCurve(1e-4), None), 0.1, 150.0, True)
    with pytest.raises(SettingError, match=r"thrusters\.largest_command"):
        drive_of(MAP, 0.1, None, True)


def test_consumption_is_recovered_from_a_current() -> None:
    force = np.linspace(-6.0, 12.0, 40)
    power = 2.0 * (4.0 + np.where(force > 0, 1.5, 2.5) * np.abs(force / 2.0) ** 1.5)
    record = Series("bollard.csv", "", force, force, voltage=np.full(40, 23.0), extras={"current_A": power / 23.0})
    assert consumption([record], per_test=2, volts=24.0) == pytest.approx((4.0, 1.5, 2.5), rel=1e-9)
    with pytest.raises(RunError, match=r"0 rows .* name the column power_W or current_A"):
        consumption([Series("bollard.csv", "", force, force)], 1, 24.0)


def command_rows(*arguments: object) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(command_file(*arguments))))  # type: ignore[arg-type]


def test_a_command_file_holds_each_moment_until_the_next() -> None:
    coast = PaperRun("coast-down", "coast", ((-1.2, 2.5), (0.0, 5.0)))
    rows = [tuple(row.items()) for row in command_rows(coast, 3.0, "nu", None, ColumnMap())]
    expected = (("0", "0"), ("3", "-1.2"), ("5.5", "0"), ("10.5", "0"))
    assert rows == [(("time_s", time), ("tau", moment)) for time, moment in expected]
    rest = PaperRun("rest", "rest", ((0.0, 60.0),))
    assert in_words(rest, "nu") == "nothing for 60 s, thrusters idle"  # in no golden output
    step = PaperRun("step", "s", ((0.1, 4.0),))
    row = command_rows(step, 3.0, "N m", drive_of(MAP, 0.11, 150.0, True), ColumnMap())[1]
    thrust = float(MAP.force(float(row["n_port"])) - MAP.force(float(row["n_stbd"])))
    assert 0.11 * thrust == pytest.approx(0.1, rel=1e-4)


@pytest.mark.parametrize("way", [-1, 1])
def test_commands_are_written_as_the_logs_hold_them(way: int) -> None:
    """Pulses about their neutral, percent of the other sign, a moment in per cent of a newton metre: what is read back
    by the same map is what was planned."""
    step = PaperRun("step", "s", ((way * 0.1, 4.0),))
    names = ColumnMap({
        "n_port": ColumnRule("port_us", subtract=1500.0), "n_stbd": ColumnRule("stbd %", sign=-1, scale=1.5),
        "tau": ColumnRule("moment", offset=0.05, sign_from=None),
    })  # fmt: skip
    drive = drive_of(ThrusterMap("square", PowerCurve(1e-3), PowerCurve(1e-3)), 0.2, 100.0, True)
    plain = command_rows(step, 3.0, "nu", drive, ColumnMap())
    renamed = command_rows(step, 3.0, "nu", drive, names)
    assert renamed[0] == {"time_s": "0", "port_us": "1500", "stbd %": "0"}
    for row, other in zip(renamed, plain):
        assert float(row["port_us"]) - 1500 == pytest.approx(float(other["n_port"]), abs=0.01)
        assert -1.5 * float(row["stbd %"]) == pytest.approx(float(other["n_stbd"]), rel=1e-5)
    pushed = command_rows(step, 3.0, "nu", None, names)[1]
    assert float(pushed["moment"]) + 0.05 == pytest.approx(way * 0.1)
