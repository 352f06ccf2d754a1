"""`diagnose` on thruster maps: planted effects get their names, nothing planted gets none."""

from collections.abc import Callable

import numpy as np
import pytest

from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis, diagnose_thrusters
from automarine_cli.errors import FitError, RunError
from automarine_cli.report.diagnosis_report import map_verdict
from automarine_cli.thrusters.bollard_data import Series, ThrusterLogs
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap

AHEAD, ASTERN = 40.0, 25.0  # N at full command
NOISE = 0.2  # N
LEVELS = np.linspace(0.05, 1.0, 20)
BOTH = np.concatenate([-LEVELS[::-1], LEVELS])
SHUFFLED = np.random.default_rng(5).permutation(np.tile(BOTH, 2))
FINE = np.concatenate([-np.linspace(1.0, 0.025, 40), np.linspace(0.025, 1.0, 40)])
SQUARE = ThrusterMap("square", PowerCurve(30.0), PowerCurve(30.0 / 1.3))
TIED = ThrusterMap("square", PowerCurve(30.0), PowerCurve(30.0))

Truth = Callable[[np.ndarray], np.ndarray]


def square(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * n * np.abs(n)


def exponent(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * np.sign(n) * np.abs(n) ** 1.6


def narrowed(n: np.ndarray, width: float) -> np.ndarray:
    return np.sign(n) * np.maximum(np.abs(n) - width, 0.0)


def dead_band(n: np.ndarray) -> np.ndarray:
    return square(narrowed(n, 0.12))


def ahead_only(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, dead_band(n), square(n))


def sagging(n: np.ndarray) -> np.ndarray:
    return square(n) * np.linspace(1.0, 0.85, len(n))


def logs(
    truth: Truth, seed: int = 0, n: np.ndarray = BOTH, sign: float = 1.0, voltage: np.ndarray | None = None
) -> ThrusterLogs:
    """One record; `sign` -1 mirrors command and thrust, noise included."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(n))
    return ThrusterLogs((Series("test.csv", "", sign * n, sign * (truth(n) + noise), None, voltage),), (), (), 0)


def names(result: ThrusterDiagnosis) -> list[str]:
    return sorted(effect.name for effect in result.effects)


def value(result: ThrusterDiagnosis, parameter: str) -> float:
    estimate = next(effect.parameters[parameter] for effect in result.effects if parameter in effect.parameters)
    assert estimate.value is not None
    return estimate.value


@pytest.mark.parametrize(
    ("data", "thruster_map", "expected", "parameter", "truth", "close"),
    [
        (logs(dead_band), SQUARE, "dead-band", "n_0_forward", 0.12, 0.02),
        pytest.param(logs(exponent), SQUARE, "thrust-exponent", "p_backward", 1.6, 0.06, marks=pytest.mark.slow),
        (logs(lambda n: square(np.clip(n, -0.8, 0.8))), SQUARE, "saturation", "n_sat_forward", 0.8, 0.02),
        pytest.param(logs(ahead_only), SQUARE, "dead-band", "n_0_forward", 0.12, 0.02, marks=pytest.mark.slow),
        (logs(lambda n: exponent(narrowed(n, 0.1))), SQUARE, "dead-band thrust-exponent", "n_0_forward", 0.1, 0.02),
        (logs(square), TIED, "thrust-asymmetry", "backward_over_forward", ASTERN / AHEAD, 0.0125),
        (logs(sagging, n=SHUFFLED), SQUARE, "battery-sag", "share_lost", 0.15, 0.02),
    ],
)
def test_planted(
    data: ThrusterLogs, thruster_map: ThrusterMap, expected: str, parameter: str, truth: float, close: float
) -> None:
    result = diagnose_thrusters(data, thruster_map)
    assert result.verdict == "named" and " ".join(names(result)) == expected
    assert value(result, parameter) == pytest.approx(truth, abs=close)
    assert result.held_out_gap is not None
    assert result.held_out_gap.after < 1.5 * NOISE < result.held_out_gap.before
    if expected != "battery-sag":  # which is in repeats, of which the noise is read
        assert 0.5 * NOISE < result.gap.floor < 2.0 * NOISE  # neighbours leave a corner of the curve in it


@pytest.mark.slow
def test_voltage_is_named_where_it_was_varied() -> None:
    """Something more may be claimed by chance in one of a hundred; not in most of three."""
    n = np.tile(np.concatenate([-LEVELS[::-2], LEVELS[1::2]]), 3)
    volts = np.repeat([12.0, 14.0, 16.0], 20)

    def truth(n: np.ndarray) -> np.ndarray:
        return square(n) * (volts / 14.0) ** 1.2

    results = [diagnose_thrusters(logs(truth, seed, n, voltage=volts), SQUARE) for seed in range(3)]
    assert all(result.effects[0].name == "voltage-exponent" for result in results)
    assert sum(len(result.effects) > 1 for result in results) <= 1
    for result in results:
        assert value(result, "p") == pytest.approx(1.2, abs=0.05)
        region = next(region for region in result.where.regions if region.variable == "voltage")
        assert region.runs == ("test.csv",) and "gap_N" in region.to_json("N")
        assert result.extended_map["voltage_exponent"] == {"p": result.final.power, "reference_V": 14.0}


@pytest.mark.slow
def test_nothing_planted_nothing_named() -> None:
    """A claim in one of a hundred is what the threshold allows; here one of twelve at most."""
    claims = [diagnose_thrusters(logs(square, seed), SQUARE, seed=seed) for seed in range(12)]
    assert sum(result.verdict != "nothing-missing" for result in claims) <= 1
    assert claims[0].effects == () and claims[0].extended_map["form"] == "square"
    even = diagnose_thrusters(logs(lambda n: AHEAD * n * np.abs(n)), TIED)
    assert even.verdict == "nothing-missing" and even.final.shape.tied


def test_a_gap_that_no_effect_closes_is_unexplained() -> None:
    result = diagnose_thrusters(logs(lambda n: square(n) + 2.5 * np.sin(14.0 * n)), SQUARE)
    assert result.verdict == "unexplained" and result.effects == ()
    assert result.gap.before == result.gap.after > 3 * result.gap.floor
    assert "correlated along the control signal" in map_verdict(result)


def test_a_tie_is_suspected_and_not_added() -> None:
    """A dead-band of a quarter of the lowest level: these readings do not tell it from another exponent."""
    result = diagnose_thrusters(logs(lambda n: square(narrowed(n, 0.0125)), 5), SQUARE)
    (effect,) = result.effects
    assert result.verdict == "suspected" and result.extended_map["form"] == "square"
    assert {effect.name, *(rival.name for rival in effect.rivals)} == {"dead-band", "thrust-exponent"}
    assert effect.confidence < 0.5 and map_verdict(result).startswith("Suspected, not named: ")
    assert " at n = " in effect.rivals[0].split_by


def test_mirrored_data_say_the_same() -> None:
    """The levels held out are given, as others would be chosen of the mirrored data."""
    plain, mirrored = (
        diagnose_thrusters(logs(ahead_only, sign=s), SQUARE, hold_out=logs(ahead_only, 1, sign=s)) for s in (1, -1)
    )
    assert [list(result.effects[0].parameters) for result in (plain, mirrored)] == [["n_0_forward"], ["n_0_backward"]]
    assert plain.cross.after == pytest.approx(mirrored.cross.after, rel=1e-6)
    assert value(mirrored, "n_0_backward") == pytest.approx(value(plain, "n_0_forward"), rel=1e-6)


def test_a_faulty_stretch_is_no_effect() -> None:
    result = diagnose_thrusters(logs(lambda n: square(n) * np.where((n > 0.6) & (n < 0.75), 0.8, 1.0), n=FINE), SQUARE)
    assert result.verdict == "nothing-missing" and result.gap.after < 2.0 * NOISE
    assert result.faults and all(0.58 < fault["from_n"] <= fault["to_n"] < 0.77 for fault in result.faults)


def test_what_cannot_be_diagnosed_is_refused() -> None:
    with pytest.raises(FitError, match="5 different commands"):
        diagnose_thrusters(logs(square, n=np.array([0.2, 0.4, 0.6])), SQUARE)
    with pytest.raises(FitError, match="opposite sign"):
        diagnose_thrusters(logs(lambda n: -square(n)), SQUARE)
    with pytest.raises(RunError, match="control signal is in rev/s"):
        diagnose_thrusters(logs(square), ThrusterMap("square", PowerCurve(1.0), PowerCurve(1.0), "rev/s"), n_unit="1")
