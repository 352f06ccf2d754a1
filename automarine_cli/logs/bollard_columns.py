"""Control signal and force of a bollard test looked at together: where neutral is, and what says the direction."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from automarine_cli.logs.recognise import Recognised
from automarine_cli.logs.spans import PULSES, Span, is_pulses
from automarine_cli.quantities import Floats

LITTLE = 0.1  # share of the largest force below which a force says no direction
APART = 0.97  # share of the readings that one neutral has to tell apart by the sign of their force
NEAR = 60.0  # us about the usual neutral of pulses


def directed(
    n: Recognised, force: Recognised, columns: Mapping[str, Floats], seen: Mapping[str, Span]
) -> tuple[Recognised, Recognised]:
    """Both with the neutral that the signal needs, and with the column that tells the sign of one that has none.

    `columns` are the numbers of the tests, (N,) each, by the names in the files.
    """
    good = np.isfinite(columns[n.source]) & np.isfinite(columns[force.source])
    signal, pull = columns[n.source][good], columns[force.source][good]
    if not np.any(pull):
        return n, force
    if signal.min() >= 0 and _both_ways(pull):
        found = _neutral(signal, pull)
        if found is None:
            return _turned_by(n, force, columns, seen), force
        n = _about(n, *found, (float(signal.min()) + float(signal.max())) / 2)
    elif signal.min() >= 0 and is_pulses(n.source, seen[n.source]):
        n = _about(n, PULSES[1], PULSES[1], PULSES[1])
    elif n.ask == "subtract":  # percent, 0 to 100: is there thrust in the middle?
        middle = (float(signal.min()) + float(signal.max())) / 2
        near = np.abs(signal - middle) <= LITTLE * np.ptp(signal) / 2
        rests = near.any() and np.abs(pull[near]).max() < LITTLE * np.abs(pull).max()
        n = _about(n, middle, middle, middle) if rests else replace(n, open="", ask="", more={})
    neutral = n.more.get("subtract", 0.0)
    assert isinstance(neutral, int | float)
    return n, _signed(force, n, signal - neutral, pull)


def _both_ways(values: Floats) -> bool:
    """Whether values go beyond noise to both sides of zero."""
    largest = float(np.abs(values).max(initial=0.0))
    return bool(values.min() < -LITTLE * largest and values.max() > LITTLE * largest)


def _neutral(signal: Floats, pull: Floats) -> tuple[float, float] | None:
    """Between which values of the signal the force changes its sign; None where none tells the two ways apart."""
    strong = np.abs(pull) > LITTLE * np.abs(pull).max()
    order = np.argsort(signal[strong], kind="stable")
    value, ahead = signal[strong][order], pull[strong][order] > 0
    right = np.cumsum(~ahead) + ahead.sum() - np.cumsum(ahead)  # astern up to here, ahead from here on
    share = np.maximum(right, len(value) - right)[:-1] / len(value)
    share = np.where(np.diff(value) > 0, share, 0.0)
    best = int(np.argmax(share)) if len(share) else 0
    return (float(value[best]), float(value[best + 1])) if len(share) and share[best] >= APART else None


def _about(n: Recognised, low: float, high: float, middle: float) -> Recognised:
    """The signal less its neutral, which lies between two values: that of pulses, or the middle of the range."""
    seen, usual = n.seen.partition(",")[0], PULSES[1]
    told = f"about {low:.5g}" if low == high else f"the force changes sign between {low:.5g} and {high:.5g}"
    told = "pulses about 1500" if low == high == usual else told
    if PULSES[0] <= low - NEAR <= usual <= high + NEAR:
        return replace(n, unit="us", open="", ask="", more={"subtract": usual}, seen=f"{seen}, {told}")
    if low <= middle <= high:
        return replace(n, open="", ask="", more={"subtract": middle}, seen=f"{seen}, {told}")
    why = f"the force changes sign between {low:.4g} and {high:.4g}: at which value does the thruster stop?"
    return replace(n, open=why, more={"subtract": float(f"{(low + high) / 2:.3g}")}, ask="subtract")


def _turned_by(n: Recognised, force: Recognised, columns: Mapping[str, Floats], seen: Mapping[str, Span]) -> Recognised:
    """The unsigned signal with the sign of a command beside it that goes the way of the force, else of the force."""
    pull, other = columns[force.source], _signed_by(force.source, 0)
    strong = np.abs(pull) > LITTLE * np.nanmax(np.abs(pull))
    for name, values in columns.items():
        neutral = PULSES[1] if is_pulses(name, seen[name]) else 0
        agree = np.mean(np.sign(values[strong] - neutral) == np.sign(pull[strong]))
        if name not in (n.source, force.source) and agree >= APART:
            other = _signed_by(name, neutral)
            break
    told = f"never below 0 while {force.source} goes from {np.nanmin(pull):.4g} to {np.nanmax(pull):.4g}: unsigned"
    return replace(n, open="", ask="", seen=f"{n.seen}, {told}", more={"sign_from": other})


def _signed(force: Recognised, n: Recognised, signal: Floats, pull: Floats) -> Recognised:
    """The force with the sign of the command where it has none itself although the command goes both ways; where it
    goes against the command, the sign is asked for."""
    if n.ask or "sign_from" in n.more or not _both_ways(signal):
        return force
    back = signal < -LITTLE * np.abs(signal).max()
    if pull.min() >= -LITTLE * pull.max() and pull[back].max(initial=0.0) > LITTLE * pull.max():
        told = f"{force.seen}, one sign while {n.source} goes both ways: unsigned"
        neutral = n.more.get("subtract", 0)
        assert isinstance(neutral, int | float)
        return replace(force, seen=told, more={"sign_from": _signed_by(n.source, neutral)})
    if np.sum(signal * np.abs(signal) * pull) < 0:
        why = f"negative while {n.source} drives ahead: -1 if ahead is logged as negative force"
        return replace(force, open=why, more={"sign": -1}, ask="sign")
    return force


def _signed_by(name: str, neutral: float) -> object:
    """The value of `sign_from`."""
    return {"from": name, "subtract": neutral} if neutral else name
