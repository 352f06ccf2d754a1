"""What a velocity sensor adds to its readings in one run, and whether its readings were computed from the position.

Where the position is nothing but noise, its noise and that of a sensor of its own have nothing in common; a velocity
that was computed from it, or with it by one estimator, follows it.
"""

from collections.abc import Sequence

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import position_noise, slope
from automarine_cli.runs.run import Run

FEWEST = 8
"""Readings."""


def unbiased_velocity(run: Run) -> Floats | None:
    """The velocity logged, (N,), less its bias, by which its sum runs away from the position; NaN where there is no
    reading, None where there are hardly any."""
    read = run.extras.get(run.dof.velocity)
    if read is None:
        return None
    good = np.isfinite(read)
    if good.sum() < FEWEST:
        return None
    time, velocity = run.time[good], read[good]
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    return np.asarray(read - slope(time, summed - run.position[good])[0])


def velocity_noise(run: Run) -> float:
    """Noise of the velocity logged, apart from any model; zero where there is none."""
    read = run.extras.get(run.dof.velocity)
    if read is None:
        return 0.0
    good = np.isfinite(read)
    return position_noise(run.time[good], read[good])


SEGMENTS = (16, 32, 128)
"""Samples of a segment of the spectra: filters of different length show in each."""
FEWEST_SEGMENTS, MANY_SEGMENTS = 10, 24
"""Segments of a spectrum, and from which on single octaves can be told."""
LUCK = 9.0
"""Share of a bin's power, times the segments, that chance explains in one of a thousand: these overlap by half."""
NOISE_BAND = 1.6
"""The position is noise at frequencies where its spectrum is no more than so many times the lowest."""
LEAST_NOISE = 1e-6
"""Of positions [rad or m]; what is less is arithmetic."""


def noise_followed(pairs: Sequence[tuple[Floats, Floats]]) -> float | None:
    """Share of a velocity's power that the position's noise explains through any linear filter, in the octave where it
    explains most among the frequencies where the position is nothing but noise; None where too little is logged, or
    nothing there is noise.

    Spectra of third differences of the position and second ones of the velocity, which take smooth motion off, over
    the quieter half of the segments: where a command changed both see the same kink.
    """
    rough = [(np.diff(position, 3), np.diff(velocity, 2)) for position, velocity in pairs]
    found = [share for size in SEGMENTS if (share := _followed(rough, size)) is not None]
    return max(found, default=None)


def _followed(rough: Sequence[tuple[Floats, Floats]], size: int) -> float | None:
    """The same from segments of `size` samples of the differences, less what chance would explain of so few."""
    pairs = [(a[i : i + size], b[i : i + size]) for a, b in rough for i in range(0, len(a) - size + 1, size // 2)]
    if len(pairs) < 2 * FEWEST_SEGMENTS:
        return None
    levels = [float(a @ a) for a, _ in pairs]
    quiet = np.argsort(levels, kind="stable")[: len(levels) // 2]
    window, inner = np.hanning(size), np.arange(1, size // 2)
    first, second = (np.fft.rfft(window * np.array([pairs[i][k] for i in quiet]), axis=1)[:, inner] for k in (0, 1))
    turn = np.abs(1.0 - np.exp(-2j * np.pi * inner / size)) ** 2
    of_position, of_velocity = (np.abs(first) ** 2).mean(axis=0), (np.abs(second) ** 2).mean(axis=0)
    across = np.abs((first * second.conj()).mean(axis=0)) ** 2
    position = of_position / turn**3
    floor = np.sort(position)[: size // 8].mean()
    if floor <= LEAST_NOISE**2 * float(window @ window):
        return None
    noise = position <= NOISE_BAND * floor
    power, explained = of_velocity / turn**2, across / np.maximum(of_position, 1e-300) / turn**2
    octaves = [noise]
    if len(quiet) >= MANY_SEGMENTS:
        octaves = [noise & (inner >= low) & (inner < 2 * low) for low in 2 ** np.arange(int(np.log2(size)) - 1)]
    shares = [
        float(explained[one].sum() / power[one].sum() - LUCK / (len(quiet) * np.sqrt(one.sum())))
        for one in octaves
        if power[one].sum() > 0
    ]
    return max(shares, default=None)
