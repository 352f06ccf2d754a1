"""Campaigns whose gyro is honest, faulty, or no gyro at all, and what is said of it."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import response
from automarine_cli.runs.channels import choose_channels
from automarine_cli.runs.run import Run

Floats = NDArray[np.float64]

STREAM = 70
HONEST = "honest"
DEGREE = np.pi / 180
WORDS = {
    "was computed from": "computed",
    "does not follow": "unrelated",
    "wrong sign": "sign",
    "is in rad": "radians",
    "is in deg": "degrees",
    "late against": "late",
    "ahead of": "ahead",
    "reads": "scale",
    "stuck": "stuck",
}
FAULTS: dict[str, tuple[str, ...]] = {
    HONEST: ("",),
    "wrong sign": ("sign",),
    "read as degrees, is radians": ("radians", "stuck"),
    "read as radians, is degrees": ("degrees",),
    "another motion's": ("unrelated", "scale", "sign", "late", "ahead", "degrees", "radians"),
    "stuck": ("stuck",),
    "reads 10 % more": ("scale",),
    "0.5 s late": ("late",),
    "0.5 s ahead": ("ahead",),
    "gradient of the heading": ("computed",),
    "backward difference": ("computed",),
    "parabolas over 0.5 s": ("computed",),
    "low-pass of 0.3 s": ("computed",),
    "observer of 0.5 s": ("computed",),
}
"""Each with what may be said of it; where many decimals are lost, a rate in radians looks stuck."""


def judged(item: tuple[int, str]) -> str:
    """What is said of the gyro of the campaign of that number, in a word; nothing for an honest one."""
    index, fault = item
    said = choose_channels(made(index, fault), YAW).verdicts[1].why
    return next((word for part, word in WORDS.items() if part in said), said)


def made(index: int, fault: str) -> list[Run]:
    """A campaign of steps; everything about vehicle and sensors is drawn."""
    random = np.random.default_rng([STREAM, index])
    period, noise, rate_noise = 1.0 / random.choice([5, 10, 20, 50]), *_noises(random)
    bias, count = DEGREE * random.choice([0.0, 0.5, 2.0, 5.0]), int(random.choice([6, 12, 24, 48]))
    grain, fine = DEGREE * random.choice([0.001, 0.1, 1.0]), DEGREE * random.choice([0.001, 0.01, 0.1, 0.5])
    rest, pace = random.choice([1.0, 3.0]), DEGREE * random.choice([15, 30, 60, 90])
    angle = random.choice([0.3, 0.6, 1.2])
    drag = 1.0 / pace**2
    runs = []
    for i in range(count):
        moment = (1 if i % 2 else -1) * random.choice([0.2, 0.4, 0.7, 1.0])
        length = rest + (1.3 * np.pi + 2.0 * angle) / np.sqrt(abs(moment)) / pace
        time = np.arange(0.0, length, period)
        since = time - rest + period * random.uniform()
        heading, rate = response(since, moment, angle * drag, 0.0, drag)
        late = {"0.5 s late": 0.5, "0.5 s ahead": -0.5}.get(fault, 0.0)
        if late:
            rate = response(since - late, moment, angle * drag, 0.0, drag)[1]
        noisy = heading + random.uniform(-3.0, 3.0) + noise * random.standard_normal(len(time))
        noisy = grain * np.round(noisy / grain)
        other = rate + bias * random.standard_normal() + rate_noise * random.standard_normal(len(time))
        read = fine * np.round(faulty(fault, time, noisy, other, random) / fine)
        command = np.where(since > 0, moment, 0.0)
        runs.append(Run(f"run {i}", "made", time, noisy, command, "nu", {"yaw_rate": read}, dof=YAW))
    return runs


def _noises(random: np.random.Generator) -> tuple[float, float]:
    return DEGREE * random.choice([0.1, 0.3, 1.0, 2.0]), DEGREE * random.choice([0.05, 0.1, 0.3, 1.0, 2.0])


def faulty(fault: str, time: Floats, heading: Floats, rate: Floats, random: np.random.Generator) -> Floats:
    """What stands in the column of the rate."""
    period = time[1] - time[0]
    match fault:
        case "wrong sign":
            return -rate
        case "read as degrees, is radians":
            return rate * DEGREE
        case "read as radians, is degrees":
            return rate / DEGREE
        case "another motion's":
            share = period / (period + 0.3)
            return 10.0 * DEGREE / np.sqrt(share) * filtered(random.standard_normal(len(time)), share)
        case "stuck":
            return np.full_like(rate, rate[0])
        case "reads 10 % more":
            return 1.1 * rate
        case "gradient of the heading":
            return np.gradient(heading, time)
        case "backward difference":
            return np.append(0.0, np.diff(heading) / period)
        case "parabolas over 0.5 s":
            width = max(5, 2 * round(0.25 / period) + 1)
            return np.asarray(savgol_filter(heading, width, 2, deriv=1, delta=period))
        case "low-pass of 0.3 s":
            return filtered(np.gradient(heading, time), period / (period + 0.3))
        case "observer of 0.5 s":
            return observed(heading, period, 4.0)
    return rate


def filtered(values: Floats, share: float) -> Floats:
    """Values (N,) behind a low-pass of first order."""
    out = values.copy()
    for i in range(1, len(values)):
        out[i] = out[i - 1] + share * (values[i] - out[i - 1])
    return out


def observed(heading: Floats, period: float, pace: float) -> Floats:
    """The rate (N,) that an observer of second order, `pace` [rad/s] fast, tells of headings."""
    where, rate, out = heading[0], 0.0, np.zeros_like(heading)
    first, second = min(2.0 * pace * period, 0.9), pace**2 * period
    for i, read in enumerate(heading):
        off = read - where - rate * period
        where, rate = where + rate * period + first * off, rate + second * off
        out[i] = rate
    return out
