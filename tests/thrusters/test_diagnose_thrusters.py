"""`diagnose` on thruster maps: planted effects get their names, nothing planted gets none, real tables reach marks."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from figures import drawn
from repository import DATA

from automarine_cli.commands.diagnose import diagnose
from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis, diagnose_thrusters
from automarine_cli.errors import FitError, RunError
from automarine_cli.pipeline.records import schema_in
from automarine_cli.report.diagnosis_report import map_verdict
from automarine_cli.report.sections import sections
from automarine_cli.report.tables import Table
from automarine_cli.thrusters.bollard_data import Series, ThrusterLogs
from automarine_cli.thrusters.map import THRUSTER_MAP, Curve, ThrusterMap

TESTS = DATA / "thrusters"

AHEAD, ASTERN = 40.0, 25.0  # N at full command
NOISE = 0.2  # N
LEVELS = np.linspace(0.05, 1.0, 20)
BOTH = np.concatenate([-LEVELS[::-1], LEVELS])
EVERY_OTHER = np.concatenate([-LEVELS[::-2], LEVELS[1::2]])
SQUARE = ThrusterMap("square", Curve(30.0), Curve(30.0 / 1.3))
TIED = ThrusterMap("square", Curve(30.0), Curve(30.0))

Truth = Callable[[np.ndarray], np.ndarray]


def square(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * n * np.abs(n)


def dead_band(n: np.ndarray) -> np.ndarray:
    return square(np.sign(n) * np.maximum(np.abs(n) - 0.12, 0.0))


def exponent(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * np.sign(n) * np.abs(n) ** 1.6


def saturation(n: np.ndarray) -> np.ndarray:
    return square(np.clip(n, -0.8, 0.8))


def ahead_only(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, dead_band(n), square(n))


def logs(
    truth: Truth, seed: int = 0, n: np.ndarray = BOTH, sign: float = 1.0, voltage: np.ndarray | None = None
) -> ThrusterLogs:
    """One record; `sign` -1 mirrors command and thrust, noise included."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(n))
    record = Series("test.csv", "", sign * n, sign * (truth(n) + noise), None, voltage)
    return ThrusterLogs((record,), (), (), 0)


def names(result: ThrusterDiagnosis) -> list[str]:
    return [effect.name for effect in result.effects]


def value(result: ThrusterDiagnosis, parameter: str) -> float:
    found = next(effect.parameters[parameter] for effect in result.effects if parameter in effect.parameters)
    assert found.value is not None
    return found.value


@pytest.mark.parametrize(
    ("truth", "name", "parameter", "expected", "close"),
    [
        (dead_band, "dead-band", "n_0_forward", 0.12, 0.02),
        (exponent, "thrust-exponent", "p_backward", 1.6, 0.06),
        (saturation, "saturation", "n_sat_forward", 0.8, 0.02),
        (ahead_only, "dead-band", "n_0_forward", 0.12, 0.02),
    ],
)
def test_a_planted_effect_gets_its_name(truth: Truth, name: str, parameter: str, expected: float, close: float) -> None:
    result = diagnose_thrusters(logs(truth), SQUARE)
    assert result.verdict == "named" and names(result) == [name]
    assert value(result, parameter) == pytest.approx(expected, abs=close)
    assert result.held_out_gap is not None
    assert result.held_out_gap.after < 1.5 * NOISE < result.held_out_gap.before
    assert 0.5 * NOISE < result.gap.floor < 2.0 * NOISE  # neighbours leave a corner of the curve in it
    if truth is ahead_only:
        assert list(result.effects[0].parameters) == ["n_0_forward"]


def test_asymmetry_is_missing_from_a_map_with_one_curve() -> None:
    result = diagnose_thrusters(logs(square), TIED)
    assert names(result) == ["thrust-asymmetry"]
    assert value(result, "backward_over_forward") == pytest.approx(ASTERN / AHEAD, rel=0.02)
    even = diagnose_thrusters(logs(lambda n: AHEAD * n * np.abs(n)), TIED)
    assert even.verdict == "nothing-missing" and even.final.shape.tied


def test_two_planted_effects_are_both_named() -> None:
    def both(n: np.ndarray) -> np.ndarray:
        return exponent(np.sign(n) * np.maximum(np.abs(n) - 0.1, 0.0))

    result = diagnose_thrusters(logs(both), SQUARE)
    assert sorted(names(result)) == ["dead-band", "thrust-exponent"]
    assert value(result, "n_0_forward") == pytest.approx(0.1, abs=0.02)


@pytest.mark.slow
def test_voltage_is_named_where_it_was_varied() -> None:
    """Something more may be claimed by chance in one of a hundred; not in most of three."""
    n, volts = np.tile(EVERY_OTHER, 3), np.repeat([12.0, 14.0, 16.0], 20)

    def truth(n: np.ndarray) -> np.ndarray:
        return square(n) * (volts / 14.0) ** 1.2

    found = [diagnose_thrusters(logs(truth, seed, n, voltage=volts), SQUARE) for seed in range(3)]
    assert all(names(result)[0] == "voltage-exponent" for result in found)
    assert sum(len(names(result)) > 1 for result in found) <= 1
    for result in found:
        assert value(result, "p") == pytest.approx(1.2, abs=0.05)
        region = next(region for region in result.where.regions if region.variable == "voltage")
        keys = {"variable", "from", "to", "unit", "gap_N", "p_value", "runs"}
        assert keys <= set(region.to_json("N")) and region.runs == ("test.csv",)
        assert result.extended_map["voltage_exponent"] == {"p": result.final.power, "reference_V": 14.0}


def test_sag_is_named_where_the_order_was_random() -> None:
    n = np.random.default_rng(5).permutation(np.tile(BOTH, 2))
    order = np.linspace(0.0, 1.0, len(n))
    result = diagnose_thrusters(logs(lambda n: square(n) * (1.0 - 0.15 * order), n=n), SQUARE)
    assert names(result) == ["battery-sag"]
    assert value(result, "share_lost") == pytest.approx(0.15, abs=0.02)


def test_nothing_planted_nothing_named() -> None:
    """A claim in one of a hundred is what the threshold allows; here one of twelve at most."""
    claims = [diagnose_thrusters(logs(square, seed), SQUARE, seed=seed) for seed in range(12)]
    assert sum(result.verdict != "nothing-missing" for result in claims) <= 1
    one = claims[0]
    assert one.effects == () and one.extended_map["form"] == "square"


def test_a_gap_that_no_effect_closes_is_unexplained() -> None:
    result = diagnose_thrusters(logs(lambda n: square(n) + 2.5 * np.sin(14.0 * n)), SQUARE)
    assert result.verdict == "unexplained" and result.effects == ()
    assert result.gap.before == result.gap.after > 3 * result.gap.floor
    assert "correlated along the control signal" in map_verdict(result)


def test_a_tie_is_suspected_and_not_added() -> None:
    """A dead-band of a quarter of the lowest level: these readings do not tell it from another exponent."""

    def narrow(n: np.ndarray) -> np.ndarray:
        return square(np.sign(n) * np.maximum(np.abs(n) - 0.0125, 0.0))

    result = diagnose_thrusters(logs(narrow, 5), SQUARE)
    (effect,) = result.effects
    assert result.verdict == "suspected" and result.extended_map["form"] == "square"
    assert {effect.name, *(rival.name for rival in effect.rivals)} == {"dead-band", "thrust-exponent"}
    assert effect.confidence < 0.5 and map_verdict(result).startswith("Suspected, not named: ")
    assert " at n = " in effect.rivals[0].split_by


def test_mirrored_data_say_the_same() -> None:
    plain = diagnose_thrusters(logs(ahead_only), SQUARE)
    mirrored = diagnose_thrusters(
        logs(ahead_only, sign=-1.0), ThrusterMap("square", SQUARE.backward, SQUARE.forward), hold_out=None
    )
    assert names(mirrored) == names(plain) == ["dead-band"]
    # Other levels are held out of the mirrored data: the same but for the noise.
    assert value(mirrored, "n_0_backward") == pytest.approx(value(plain, "n_0_forward"), abs=0.02)
    whole = [
        diagnose_thrusters(logs(ahead_only, sign=s), SQUARE, hold_out=logs(ahead_only, 1, sign=s)) for s in (1, -1)
    ]
    assert whole[0].cross.after == pytest.approx(whole[1].cross.after, rel=1e-6)
    assert value(whole[1], "n_0_backward") == pytest.approx(value(whole[0], "n_0_forward"), rel=1e-6)


def test_a_faulty_stretch_is_its_own_finding() -> None:
    n = np.concatenate([-np.linspace(1.0, 0.025, 40), np.linspace(0.025, 1.0, 40)])

    def broken(n: np.ndarray) -> np.ndarray:
        return square(n) * np.where((n > 0.6) & (n < 0.75), 0.8, 1.0)

    result = diagnose_thrusters(logs(broken, n=n), SQUARE)
    assert result.verdict == "nothing-missing"
    stretch = [fault for fault in result.faults if fault.kind == "faulty-stretch"]
    assert stretch and all(0.58 < fault.from_n <= fault.to_n < 0.77 for fault in stretch)
    assert result.gap.after < 2.0 * NOISE


def test_second_look_finds_nothing_more() -> None:
    first = diagnose_thrusters(logs(ahead_only), SQUARE)
    again = ThrusterMap.from_json(json.loads(json.dumps(first.extended_map)))
    second = diagnose_thrusters(logs(ahead_only), again)
    assert second.verdict == "nothing-missing"
    assert second.gap.before == pytest.approx(first.gap.after, rel=1e-3)
    assert again.force(np.array([0.1])) == pytest.approx(0.0) and again.force(np.array([-0.1])) < 0


def test_what_cannot_be_diagnosed_is_refused() -> None:
    with pytest.raises(FitError, match="5 different commands"):
        diagnose_thrusters(logs(square, n=np.array([0.2, 0.4, 0.6])), SQUARE)
    with pytest.raises(FitError, match="opposite sign"):
        diagnose_thrusters(logs(lambda n: -square(n)), SQUARE)
    with pytest.raises(RunError, match="control signal is in rev/s"):
        diagnose_thrusters(logs(square), ThrusterMap("square", Curve(1.0), Curve(1.0), "rev/s"), n_unit="1")


def write_csv(path: Path, data: ThrusterLogs) -> Path:
    record = data.records[0]
    rows = "\n".join(f"{n:.6f},{force:.6f}" for n, force in zip(record.n, record.force))
    path.write_text(f"n,force_N\n{rows}\n", encoding="utf-8")
    return path


@pytest.mark.slow
def test_results_are_whole_and_the_same_bytes(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", logs(dead_band))
    other = write_csv(tmp_path / "other.csv", logs(dead_band, 1))
    model = tmp_path / "thrusters.json"
    model.write_text(json.dumps(SQUARE.to_json()), encoding="utf-8")
    assert schema_in(model) == THRUSTER_MAP.schema and schema_in(log) != THRUSTER_MAP.schema
    with drawn():
        result = diagnose([log], model=model, out=tmp_path / "one", jobs=1)
    diagnose([log], model=model, out=tmp_path / "two", jobs=2)
    for name in ("diagnosis.json", "extended_model.json", "diagnosis.md", "why.png", "manifest.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    written = json.loads((tmp_path / "one" / "diagnosis.json").read_text(encoding="utf-8"))
    assert written == json.loads(json.dumps(result.to_json()))
    assert written["schema"] == "automarine/diagnosis/1" and written["verdict"] == "named"
    assert set(written["gap"]["held_out_runs"]) == {"before_N", "after_N", "noise_floor_N"}
    assert str(tmp_path) not in (tmp_path / "one" / "diagnosis.md").read_text(encoding="utf-8")
    assert all(part.to_text() for part in sections(result).printed if isinstance(part, Table))
    held = diagnose([log, other], model=model, hold_out=[other])
    assert held.held_out is not None and held.held_out.levels == 40 and names(held) == ["dead-band"]
    assert held.held_out_gap is not None and held.held_out_gap.after < 1.5 * NOISE


def on_table(tmp_path: Path, name: str, columns: str, volts: float | None = None) -> ThrusterDiagnosis:
    """Diagnose the square law on a real table; `volts` takes one voltage of it."""
    source, (map_file, column_file) = TESTS / name, (tmp_path / "map.json", tmp_path / "columns.toml")
    map_file.write_text(json.dumps(SQUARE.to_json()), encoding="utf-8")
    column_file.write_text(columns, encoding="utf-8")
    if volts is not None:
        with source.open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
        source = tmp_path / "one.csv"
        with source.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([rows[0], *(row for row in rows[1:] if float(row[0]) == volts)])
    return diagnose([source], model=map_file, columns=column_file)


COMMAND = '[columns]\nn = "cmd"\nforce_N = "force_n"\n'
SPEED = '[columns]\nn = { from = "n_rev_s", unit = "rev/s" }\nforce_N = "force_n"\n'


@pytest.mark.real_data(TESTS)
@pytest.mark.parametrize(
    ("name", "columns", "volts", "expected", "before", "after"),
    [
        ("t200_br2019_10-20V.csv", COMMAND, 12.0, ["dead-band", "thrust-exponent"], 4.3, 0.6),
        ("t200_br2019_10-20V.csv", SPEED, 12.0, ["thrust-exponent"], 0.9, 0.5),
        ("videoray_m5_nezprop.csv", COMMAND, None, ["dead-band", "saturation", "thrust-exponent"], 13.4, 3.0),
        ("videoray_m5_vrprop.csv", COMMAND, None, ["thrust-exponent"], 23.4, 1.6),
        ("kingfisher_heron_bollard_mean.csv", COMMAND, None, ["saturation"], 13.5, 4.6),
    ],
)
def test_real_tables(
    tmp_path: Path, name: str, columns: str, volts: float | None, expected: list[str], before: float, after: float
) -> None:
    """Known: against a command the square law lacks an exponent and often more; against speed hardly anything."""
    result = on_table(tmp_path, name, columns, volts)
    assert result.verdict == "named" and sorted(names(result)) == expected
    assert result.percent(result.gap.before) == pytest.approx(before, rel=0.03)
    assert result.percent(result.cross.after) < after
    assert result.held_out_gap is not None
    assert result.held_out_gap.after < 0.5 * result.held_out_gap.before
    computed = [fault for fault in result.faults if fault.kind == "computed"]
    assert bool(computed) == ("vrprop" in name)
