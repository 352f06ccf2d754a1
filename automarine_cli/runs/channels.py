"""Which of the sensors in the logs count as evidence: those that agree, unless somebody says otherwise.

Over a stretch of a run the position is  x(t) = c + b t + s V(t + d) + noise, with V the sum of the velocities read, b
the sensor's bias, s its scale and d how late it is. c and b are each stretch's own; s and d are the sensor's, and are
told robustly: a stretch with a slipping compass has no more say than another. Where the position is nothing but noise,
its noise and that of a sensor of its own have nothing in common; a velocity that was computed from it, or with it by
one estimator, follows it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.logs.columns import names_of
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run, median, position_noise, slope, summed
from automarine_cli.text import listed

MIN_READINGS = 8  # Readings


def unbiased_velocity(run: Run) -> Floats | None:
    """The velocity logged, (N,), less its bias, by which its sum runs away from the position; NaN where there is no
    reading, None where there are hardly any."""
    velocity = run.extras.get(run.dof.velocity)
    if velocity is None or np.isfinite(velocity).sum() < MIN_READINGS:
        return None
    good = np.isfinite(velocity)
    drift, _ = slope(run.time[good], summed(run.time[good], velocity[good]) - run.position[good])
    return np.asarray(velocity - drift)


def velocity_noise(run: Run) -> float:
    """Noise of the velocity logged, apart from any model; zero where there is none."""
    velocity = run.extras.get(run.dof.velocity, np.zeros(0))
    good = np.isfinite(velocity)
    return position_noise(run.time[: len(velocity)][good], velocity[good])


SEGMENTS = (16, 32, 128)  # Samples of a segment of the spectra: filters of different length show in each
MIN_SEGMENTS, MANY_SEGMENTS = 10, 24  # Segments of a spectrum, and from which on single octaves can be told
LUCK = 9.0
"""Share of a bin's power, times the segments, that chance explains in one of a thousand: these overlap by half."""
NOISE_BAND = 1.6  # The position is noise at frequencies where its spectrum is no more than so many times the lowest
MIN_NOISE = 1e-6  # Of positions [rad or m]; what is less is arithmetic


def noise_followed(pairs: Sequence[tuple[Floats, Floats]]) -> float | None:
    """Share of a velocity's power that the position's noise explains through any linear filter, in the octave where it
    explains most among the frequencies where the position is nothing but noise; None where too little is logged, or
    nothing there is noise.

    Spectra of third differences of the position and second ones of the velocity, which take smooth motion off, over
    the quieter half of the segments: where a command changed both see the same kink.
    """
    rough = [(np.diff(position, 3), np.diff(velocity, 2)) for position, velocity in pairs]
    return max((share for size in SEGMENTS if (share := _followed(rough, size)) is not None), default=None)


def _followed(rough: Sequence[tuple[Floats, Floats]], size: int) -> float | None:
    """The same from segments of `size` samples of the differences, less what chance would explain of so few."""
    pairs = [(a[i : i + size], b[i : i + size]) for a, b in rough for i in range(0, len(a) - size + 1, size // 2)]
    if len(pairs) < 2 * MIN_SEGMENTS:
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
    if floor <= MIN_NOISE**2 * float(window @ window):
        return None
    noise = position <= NOISE_BAND * floor
    power, explained = of_velocity / turn**2, across / np.maximum(of_position, 1e-300) / turn**2
    octaves = [noise]
    if len(quiet) >= MANY_SEGMENTS:
        octaves = [noise & (inner >= low) & (inner < 2 * low) for low in 2 ** np.arange(int(np.log2(size)) - 1)]
    shares = (
        float(explained[octave].sum() / power[octave].sum() - LUCK / (len(quiet) * np.sqrt(octave.sum())))
        for octave in octaves
        if power[octave].sum() > 0
    )
    return max(shares, default=None)


LONGEST = 20.0  # s; longer runs are cut up, for biases wander
MIN_SAMPLES = 12  # Samples of a stretch
MIN_STRETCHES = 3  # Stretches whose scatter tells anything
MAX_STRETCHES = 200  # Stretches that are looked at, evenly over the campaign
STRETCH_GAP = 3.0  # Sample periods; a longer hole parts two stretches
MOVES, SEEN = 5.0, 2.0
"""A stretch tells of scale and clock if its motion, less a line, is so many times what noise makes of the summed
velocities, and of the position: the former would bias the scale, the latter only blurs it."""
LATEST = 5.0  # s; clocks are not looked at further apart
GRID, FINE = 60, 40  # Delays tried to either side: first over all, then between neighbours of the best
OF_ONE = np.log(1.5)  # Scales this near to one, as a logarithm, may be those of a sensor whose clock is off
DRAWS = 200  # Resamples of the stretches for the doubt of a delay
REPEATS = 0.8  # Share of one exact reading from which on a sensor is stuck where the position goes elsewhere
BENDS = 0.04  # Share of all its way by which a position then leaves a straight line


@dataclass(frozen=True)
class Stretch:
    """Samples of a run in which both sensors read: arrays (n,), times since the first [s]; `summed` is the sum of the
    velocities."""

    time: Floats
    position: Floats
    velocity: Floats
    summed: Floats
    period: float
    position_noise: float
    velocity_noise: float


@dataclass(frozen=True)
class Agreement:
    """What `moving` stretches say of a velocity sensor: `correlation` of its sum with the position, both less a line;
    `scale` and `late` [s] by which it reads too small and too late, with standard errors, and whether the `clock`
    explains more of what is left than the scale; `period` [s] of the slower of the two sensors; `follows` the share of
    its power, where the position is noise, that is this noise filtered (None: not to be told); `stuck` names the runs
    in which it repeats one value while the vehicle moves."""

    moving: int
    correlation: float
    scale: float
    scale_error: float
    late: float
    late_error: float
    clock: bool
    period: float
    follows: float | None
    stuck: tuple[str, ...]
    stuck_at: float = 0.0


def agreement(runs: Sequence[Run], quantity: str) -> Agreement:
    """Compare the channel `quantity`, a velocity, with the positions of the runs that have both."""
    good = [run for run in runs if run.channel(quantity) is not None and not run.summed_up and len(run) >= MIN_SAMPLES]
    stuck = {run.name: at for run in good if (at := _stuck_at(run, quantity)) is not None}
    names, at = tuple(stuck), median(np.array([*stuck.values()])) if stuck else 0.0
    every = [stretch for run in good if run.name not in stuck for stretch in stretches(run, quantity)]
    if len(every) > MAX_STRETCHES:
        every = [every[i] for i in np.linspace(0, len(every) - 1, MAX_STRETCHES).astype(int)]
    follows = noise_followed([(stretch.position, stretch.velocity) for stretch in every])
    nothing = Agreement(0, 0.0, 1.0, np.inf, 0.0, np.inf, False, 0.0, follows, names, at)
    rough = _rough(every)
    if rough is None:
        return nothing
    correlation, scale = rough
    moving = [stretch for stretch in every if _moves(stretch, abs(scale))]
    if len(moving) < MIN_STRETCHES:
        return replace(nothing, moving=len(every), correlation=correlation, scale=scale)
    fixed = 1.0 if abs(np.log(max(scale, 1e-9))) < OF_ONE else None
    late, late_error, misfit = _delay(moving, fixed)
    correlation, scale, scale_error = _scale(moving, 0.0 if fixed else late)
    clock = fixed is None or misfit < float(_misfit(moving, np.zeros(1), None).sum())
    period = max(_pace(moving, "position"), _pace(moving, "velocity"))
    return Agreement(len(moving), correlation, scale, scale_error, late, late_error, clock, period, follows, names, at)


def stretches(run: Run, quantity: str) -> list[Stretch]:
    """The parts of a run in which both sensors read without a hole."""
    readings = run.channel(quantity)
    rows = np.flatnonzero(np.isfinite(readings)) if readings is not None else np.zeros(0, dtype=int)
    if readings is None or len(rows) < MIN_SAMPLES:
        return []
    steps = np.diff(run.time[rows])
    period = median(steps)
    clock = run.time[rows] - run.time[rows[0]]
    part = np.concatenate([[0], np.cumsum(steps > STRETCH_GAP * period)]) * 1000.0
    part += np.floor(clock / max(LONGEST, MIN_SAMPLES * period))
    parts = []
    for chosen in np.split(rows, np.flatnonzero(np.diff(part)) + 1):
        if len(chosen) >= MIN_SAMPLES:
            time, position, velocity = run.time[chosen], run.position[chosen], readings[chosen]
            noises = position_noise(time, position), position_noise(time, velocity)
            parts.append(Stretch(time - time[0], position, velocity, summed(time, velocity), period, *noises))
    return parts


def _stuck_at(run: Run, quantity: str) -> float | None:
    """The one value that the sensor repeats while the position goes elsewhere, and bends, as a steady turn repeats a
    coarse reading rightly; or None."""
    readings = run.channel(quantity)
    assert readings is not None
    good = np.isfinite(readings)
    if good.sum() < MIN_SAMPLES or np.ptp(run.position) < max(run.dof.limits.unmoved, 5.0 * run.noise):
        return None
    values, counts = np.unique(readings[good], return_counts=True)
    if counts.max() < REPEATS * good.sum():
        return None
    at = float(values[counts.argmax()])
    same = readings == at
    (bent,) = _freed(run.time[same], run.position[same])
    return at if np.ptp(bent) > max(5.0 * run.noise, BENDS * np.ptp(run.position)) else None


def _freed(time: Floats, *columns: Floats) -> list[Floats]:
    centred = time - time.mean()
    square = float(centred @ centred)
    return [c - c.mean(axis=-1, keepdims=True) - (c @ centred / square)[..., None] * centred for c in columns]


def _rough(every: Sequence[Stretch]) -> tuple[float, float] | None:
    """Correlation and scale as if no sensor had a bias worth the name, from all stretches in which the position goes
    anywhere; None for none. Good for signs and units."""
    slopes = []
    for part in every:
        position, summed = part.position - part.position.mean(), part.summed - part.summed.mean()
        power = float(position @ position)
        square = max(float(summed @ summed), 1e-12 * power)
        drift = (part.velocity_noise * part.period * len(part.time)) ** 2 / 6.0  # of a sum of noise, less its mean
        if power > (MOVES * part.position_noise) ** 2 * len(part.time) and max(square, power) > MOVES**2 * drift:
            across = float(summed @ position)
            slopes.append((across / np.sqrt(square * power), across / square, power))
    if not slopes:
        return None
    correlations, scales, weights = np.array(slopes).T
    return _reached(correlations, weights), _weighted_median(scales, weights)


def _moves(part: Stretch, scale: float) -> bool:
    """By the position alone: chosen by the sum itself, those would be told of in which its noise adds to the motion."""
    (position,) = _freed(part.time, part.position)
    wander = (scale * part.velocity_noise * part.period) ** 2 * len(part.time) / 15.0  # of a sum of noise, less a line
    moved = float(position @ position) / len(part.time)
    return moved > MOVES**2 * wander and moved > SEEN**2 * part.position_noise**2


def _ahead(part: Stretch, delays: Floats) -> Floats:
    """The summed velocities read `delays` (k,) later, (k, n); beyond the ends they go on as there."""
    edge, far = max(3, min(8, len(part.time) // 4)), 2.0 * LATEST
    first, last = np.median(part.velocity[:edge]), np.median(part.velocity[-edge:])
    time = np.concatenate([[-far], part.time, [part.time[-1] + far]])
    summed = np.concatenate([[-far * first], part.summed, [part.summed[-1] + far * last]])
    return np.interp((part.time + delays[:, None]).ravel(), time, summed).reshape(len(delays), -1)


def _misfit(moving: Sequence[Stretch], delays: Floats, scale: float | None) -> Floats:
    """What each delay leaves of each stretch's positions, as half its log likelihood (stretches, delays); the scale is
    the stretch's own where it is None."""
    rows = []
    for part in moving:
        position, summed = _freed(part.time, part.position, _ahead(part, delays))
        across, square = summed @ position, (summed**2).sum(axis=1)
        slope = across / np.maximum(square, 1e-300) if scale is None else scale
        residual = position @ position - 2.0 * slope * across + slope**2 * square
        least = len(part.time) * max(part.position_noise, 1e-9) ** 2
        rows.append(0.5 * len(part.time) * np.log(np.maximum(residual, 0.0) + 0.1 * least))
    return np.array(rows)


def _delay(moving: Sequence[Stretch], scale: float | None) -> tuple[float, float, float]:
    """How late the velocity is [s], the standard error of that over stretches, and the misfit that it leaves."""
    step = min(LATEST, median(np.array([part.time[-1] for part in moving])) / 3.0) / GRID
    coarse = np.asarray(step * np.arange(-GRID, GRID + 1), dtype=np.float64)
    best = coarse[_misfit(moving, coarse, scale).sum(axis=0).argmin()]
    fine = best + 2.0 * step * np.arange(-FINE, FINE + 1) / FINE
    misfit, count = _misfit(moving, fine, scale), len(moving)
    total = misfit.sum(axis=0)
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1.0 / count), DRAWS)
    again = np.array([_lowest(fine, row) for row in drawn @ misfit])
    error = float(max(again.std() * np.sqrt(count / (count - 1)), 0.1 * step / FINE))
    return _lowest(fine, total), error, float(total.min())


def _lowest(at: Floats, values: Floats) -> float:
    i = int(np.clip(values.argmin(), 1, len(at) - 2))
    before, middle, after = values[i - 1 : i + 2]
    bend = before - 2.0 * middle + after
    return float(at[i] + (0.5 * (before - after) / bend if bend > 0 else 0.0) * (at[1] - at[0]))


def _scale(moving: Sequence[Stretch], late: float) -> tuple[float, float, float]:
    products = []
    for part in moving:
        position, summed = _freed(part.time, part.position, _ahead(part, np.array([late]))[0])
        raw, power = float(summed @ summed), float(position @ position)
        step = part.velocity_noise * part.period
        square = max(raw - (step * len(part.time)) ** 2 / 15.0, 0.5 * raw, 1e-12 * power)
        wander = np.cumsum(summed[::-1])[::-1]  # of a sum of noise, by the noise of each sample
        doubt = part.position_noise**2 * raw + step**2 * float(wander @ wander)
        products.append((float(summed @ position), square, power, doubt))
    across, squares, powers, doubts = np.array(products).T
    slopes, weights = across / squares, powers / powers.sum()
    correlation = _reached(across / np.sqrt(squares * powers), weights)
    scale = _weighted_median(slopes, weights)
    spread = 1.4826 * _weighted_median(np.abs(slopes - scale), weights) * np.sqrt((weights**2).sum())
    least = np.sqrt((weights**2 * doubts / squares**2).sum())
    return correlation, scale, 1.2533 * float(max(spread, least))


def _reached(correlations: Floats, weights: Floats) -> float:
    """The correlation that four of five stretches reach, to the side of most: sums of anything look alike in one."""
    most = _weighted_median(correlations, weights)
    least = _weighted_median(correlations, weights, 0.2 if most > 0 else 0.8)
    return least if least * most > 0 else 0.0


def _weighted_median(values: Floats, weights: Floats, share: float = 0.5) -> float:
    return float(np.quantile(values, share, weights=weights, method="inverted_cdf"))


def _pace(moving: Sequence[Stretch], name: str) -> float:
    """Median time between new values of a sensor [s] while the vehicle moves: a slow one is held between readings."""
    times = []
    for part in moving:
        fast = np.abs(part.velocity - np.median(part.velocity)) > 0.25 * np.abs(part.velocity).max()
        fresh = np.flatnonzero(np.diff(getattr(part, name)) != 0)
        spans = np.diff(part.time[fresh])[fast[fresh[1:]]]
        times.append(median(spans) if len(spans) > 3 else part.period)
    return median(np.array(times))


AUTO, POSITION, ALL = "auto", "position", "all"

FOLLOWS = 0.3
"""Share of a velocity's noise that comes from the position's from which on it counts as computed from that."""
RELATED = 0.7  # Correlation, of either sign, of velocity and position below which they are of different motions
SURELY_RELATED = 0.9  # The same where the vehicle hardly changed its velocity, and the sensor's bias may hide in it
MIN_SCALE = 0.03  # Error of scale that is none: what tilt, deviation and the sums of slow loggers make of it
MIN_LATE = 1.5  # Delay that is none, in times between readings
SURE = 5.0  # Standard errors
NEAR = 1.25  # A scale this near to that of a mistaken unit, as a factor, is that


@dataclass(frozen=True)
class ChannelVerdict:
    """One sensor: whether it is `used`, and a sentence why not, or what is odd about it (else empty)."""

    quantity: str
    used: bool
    why: str = ""


@dataclass(frozen=True)
class ChannelChoice:
    """The sensors of a campaign. `names` are those that count, None where only positions are logged and nothing was
    to be chosen; `stuck` are the runs whose velocity is left out."""

    verdicts: tuple[ChannelVerdict, ...] = ()
    names: tuple[str, ...] | None = None
    stuck: frozenset[str] = frozenset()

    def cleaned(self, run: Run) -> Run:
        """The run without readings of a sensor that is stuck in it."""
        return _without_velocity(run) if run.name in self.stuck else run

    def believed(self, run: Run) -> Run:
        """The run without a velocity that does not count, if only some sensors do."""
        counts = self.names is None or (run.dof.velocity in self.names and run.name not in self.stuck)
        return run if counts else _without_velocity(run)


def _without_velocity(run: Run) -> Run:
    return replace(run, extras={name: column for name, column in run.extras.items() if name != run.dof.velocity})


NOTHING_TO_CHOOSE = ChannelChoice()


def parse_channels(text: str, dof: Dof) -> tuple[str, ...] | None:
    """The quantities that the setting names; None for "auto" and "all". Raises SettingError for what is none."""
    if text in (AUTO, ALL):
        return None
    if text == POSITION:
        return (dof.position,)
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names or not set(names) <= set(dof.channels):
        some = f"some of {', '.join(dof.channels)} with commas between"
        raise SettingError(f"channels is {text!r}; expected {AUTO}, {POSITION}, {ALL}, or {some}")
    return names


def choose_channels(runs: Sequence[Run], dof: Dof, wanted: str = AUTO, *, late_position: bool = False) -> ChannelChoice:
    """Judge the sensors of all runs and choose, as `wanted` says.

    "auto" takes every sensor that does not contradict the position and tells something of its own, "position" that
    alone, "all" every one; else they are named, with commas between. With `late_position` a position that is read late
    is no contradiction: who asks has a name for that. Raises SettingError for a sensor that no log holds.
    """
    named = parse_channels(wanted, dof)
    read = any((column := run.channel(dof.velocity)) is not None and np.isfinite(column).any() for run in runs)
    logged = any(not run.summed_up for run in runs)
    lacking = [name for name, there in zip(dof.channels, (logged, read)) if named and name in named and not there]
    if lacking and runs:
        what, columns = lacking[0].replace("_", " "), ", ".join(names_of(lacking[0]))
        raise SettingError(f"channels is {wanted!r}, and no log holds {what}; name its column {columns} with --columns")
    if not read:
        return NOTHING_TO_CHOOSE
    sensors = agreement(runs, dof.velocity)
    trouble = trouble_of(sensors, dof, late_position) if logged else ""
    velocity = dof.velocity in named if named else wanted == ALL or not trouble
    position = logged and (named is None or dof.position in named)
    not_named = "It was not asked for (--channels)."
    summed_up = f"The logs hold no {dof.words.position}: that shown is a sum of the {dof.words.rate}, and no evidence."
    why = trouble or (_stuck_in(sensors, dof) if velocity else "") if velocity or named is None else not_named
    of_position = "" if position else not_named if logged else summed_up
    verdicts = (ChannelVerdict(dof.position, position, of_position), ChannelVerdict(dof.velocity, velocity, why))
    return ChannelChoice(verdicts, tuple(v.quantity for v in verdicts if v.used), frozenset(sensors.stuck))


def trouble_of(sensors: Agreement, dof: Dof, late_position: bool = False) -> str:
    """A sentence on what speaks against the velocity, with the remedy; empty for nothing."""
    rate, position, column = dof.words.rate, dof.words.position, names_of(dof.velocity)[0]
    correlation, scale = sensors.correlation, sensors.scale
    if sensors.follows is not None and sensors.follows > FOLLOWS:
        return (
            f"The {rate} was computed from the {position}, or both come out of one estimator "
            f"({100 * sensors.follows:.0f} % of its noise is that of the {position}): it adds no information."
        )
    if not sensors.moving:
        return _stuck_in(sensors, dof)
    if abs(correlation) < RELATED:
        return (
            f"The {rate} does not follow the {position} (correlation {correlation:.2f}): it is of another motion or "
            f"another time; check which column is meant by {column}."
        )
    if abs(correlation) < SURELY_RELATED and not np.isfinite(sensors.scale_error):
        return ""
    unit, rule = _mistaken_unit(abs(scale), dof)
    if scale < 0:
        return (
            f"The {rate} has the wrong sign (correlation {correlation:.2f} of its sum with the {position})"
            f"{unit and f', and {unit}'}; map it with sign = -1{rule and f' and {rule}'} in the --columns file."
        )
    if unit:
        return f"The {rate} {unit}; map it with {rule} in the --columns file."
    off = abs(scale - 1.0) > max(MIN_SCALE, SURE * sensors.scale_error)
    late = abs(sensors.late) > max(MIN_LATE * sensors.period, SURE * sensors.late_error)
    if late and (sensors.clock or not off):
        if late_position and sensors.late < 0:
            return ""
        way, cause = "late against", "by its clock or a filter"
        if sensors.late < 0:
            way, cause = "ahead of", f"by its clock, or because the {position} is read late"
        delay = f"{abs(sensors.late):.2g} s {way} the {position}"
        return f"The {rate} is {delay}, {cause}; if its clock is to blame, shift its column by that in the log."
    if not off:
        return ""
    return (
        f"The {rate} reads {100 * abs(1 / scale - 1):.1f} % {'less' if scale > 1 else 'more'} than the {position} "
        f"moves; if its sensor is to blame, map it with scale = {scale:.4g} in the --columns file."
    )


def _mistaken_unit(size: float, dof: Dof) -> tuple[str, str]:
    """The unit that a velocity of this scale is in, and what mends it in a column map; both empty for none."""
    base, log = f"{dof.units.base}/s", f"{dof.units.log}/s"
    units = {0.01: ("cm/s", 'unit = "cm/s"'), 0.001: ("mm/s", "scale = 0.001"), 1 / 3.6: ("km/h", "scale = 0.2778"),
             1852 / 3600: ("knots", 'unit = "kn"')}  # fmt: skip
    if dof.wraps:
        units = {dof.units.per_base: (f"{base}, not in {log}", f'unit = "{base}"'),
                 1 / dof.units.per_base: (f"{log}, not in {base}", f'unit = "{log}"')}  # fmt: skip
    for factor, (unit, rule) in units.items():
        if abs(np.log(size / factor)) < np.log(NEAR):
            times = f"{names_of(dof.velocity)[0]}: {1 / size:.3g} times what the {dof.words.position} moves"
            return f"is in {unit} ({times})", rule
    return "", ""


def _stuck_in(sensors: Agreement, dof: Dof) -> str:
    if not sensors.stuck:
        return ""
    value = f"{float(dof.logged(sensors.stuck_at)):.4g} {dof.units.log}/s"
    where = listed(sensors.stuck) if sensors.moving else "every run"
    return (
        f"The {dof.words.rate} is stuck at {value} in {where} while the {dof.words.position} moves, and left out "
        "there; check the sensor and its cable."
    )
