"""What is missing, named: the short blind set as files, answered by each tool, marked by the blind benchmark's rules.

Regression and PySINDy choose from a library of terms. It holds the true term wherever that is a function of rate,
command, heading or surge speed, and the command of 0.3 s before; nobody can write a term for what has a state of its
own (swirling water, a compass's deviation, drift, waves of unknown period).
"""

import contextlib
import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import blind_frozen
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Floats = NDArray[np.float64]
Row = dict[str, Any]
MARKS = ("right", "tie", "half", "wrong", "missed", "suspected", "unexplained", "refused")
LATE, NARROW, WIDE = 0.3, 0.1, 0.5  # s
RIVALS = {"input-delay": ["thruster-lag", "sensor-lag"]}  # one term stands for all


def write(folder: Path) -> dict[str, Any]:
    """The campaigns, once, and their key."""
    key = folder / "key.json"
    if not key.exists():
        with contextlib.redirect_stdout(io.StringIO()):
            blind_frozen.write(folder / "campaigns", key, 1, "short")
    return dict(json.loads(key.read_text()))


def base_of(place: Path) -> str:
    """The drag of the base that a user brings: "quadratic" or "linear"."""
    return "linear" if "linear-drag" in json.loads((place / "base.json").read_text()) else "quadratic"


def table_of(place: Path) -> tuple[pd.DataFrame, list[int]]:
    """The filtered acceleration and terms of all runs, one row in a second, and the run of each row.

    The rate is by a Gaussian filter of 0.1 s; acceleration and terms by the same one of 0.5 s, so that the equation
    stays true of them; what is within 3.5 of these of a run's ends is left out.
    """
    logs = [pd.read_csv(path) for path in sorted(place.glob("*.csv"))]
    period = float(np.median(np.diff(logs[0]["time_s"])))
    wide, rows, which = WIDE / period, [], list[int]()
    command = next(name for name in ("tau", "tau_Nm") if name in logs[0])
    most = max(float(log[command].abs().max()) for log in logs)
    for i, log in enumerate(logs):
        heading = np.unwrap(np.radians(log["heading_deg"]))
        rate = gaussian_filter1d(heading, max(NARROW / period, 1.0), order=1, truncate=6) / period
        terms = library(log, log[command].to_numpy(), heading, rate, period, most, base_of(place))
        smooth = terms.apply(lambda term: gaussian_filter1d(term.to_numpy(), wide, truncate=6))
        smooth.insert(0, "acceleration", gaussian_filter1d(heading, wide, order=2, truncate=6) / period**2)
        rows.append(smooth[round(3.5 * wide) : -round(3.5 * wide) : round(2 * wide)])
        which += [i] * len(rows[-1])
    return pd.concat(rows, ignore_index=True), which


def library(
    log: pd.DataFrame, tau: Floats, heading: Floats, rate: Floats, period: float, most: float, base: str
) -> pd.DataFrame:
    """The base's terms, then every other by the name of its effect; what belongs together is told by a number."""
    size, late = np.abs(tau), round(LATE / period)
    drags = {"linear": rate, "quadratic": rate * np.abs(rate)}
    other = "quadratic" if base == "linear" else "linear"
    terms = {
        "command": tau, "drag": drags[base], f"{other}-drag": drags[other], "cubic-drag": rate**3,
        "bias-moment": np.ones(len(log)), "tether-spring": heading - heading[0], "dead-band": np.sign(tau),
        "saturation": np.sign(tau) * np.maximum(size - 0.6 * most, 0.0), "thrust-asymmetry": size,
        "drag-asymmetry": rate**2, "thrust-loss": np.sqrt(size) * rate,
        "thrust-exponent": tau * np.log(np.maximum(size, 1e-9 * most) / most), "battery-sag": tau * size,
        "coulomb-drag": np.tanh(rate / 0.05), "heading-moment": np.sin(heading), "heading-moment 2": np.cos(heading),
        "wall": drags[base] * np.cos(2 * heading), "wall 2": drags[base] * np.sin(2 * heading),
        "input-delay": np.concatenate([np.zeros(late), tau[:-late]]) - tau,
    }  # fmt: skip
    if "surge_m_s" in log:
        terms["cross-coupling"] = log["surge_m_s"].to_numpy() * rate
    return pd.DataFrame(terms)


def answer_of(chosen: Sequence[str]) -> Row:
    """What a tool says that has chosen these terms."""
    names = dict.fromkeys(name.removesuffix(" 2") for name in chosen)
    effects = [{"name": name, "confidence": 1.0, "rivals": RIVALS.get(name, [])} for name in names]
    return {"verdict": "named" if effects else "nothing-missing", "effects": effects}


def summary(said: Mapping[str, Row], key: Mapping[str, Row]) -> Row:
    """How many campaigns have which mark, and how many names were given that are not hidden."""
    marks, false = Counter[str](), 0
    for name, truth in key.items():
        if name not in said:
            continue
        answer = said[name]
        named = {each["name"]: list(each.get("rivals", ())) for each in answer["effects"]}
        mark = blind_frozen.judge(truth["hidden"], answer["verdict"], named)
        marks["refused" if answer["verdict"] == "refused" else "wrong" if mark in ("false", "learned") else mark] += 1
        if answer["verdict"] == "named":
            false += sum(not ({name, *rivals} & set(truth["effects"])) for name, rivals in named.items())
    return {**{mark: marks[mark] for mark in MARKS}, "false claims": false, "campaigns": sum(marks.values())}
