"""Which sensors count as evidence: those that agree, unless the user says otherwise.

Over a stretch of a run the position is x(t) = c + b t + s V(t + d) + noise, with V the sum of the velocities read, bias
b of the stretch, and scale s and delay d of the sensor, estimated robustly. A velocity that was computed from the
position follows its noise where the position is nothing but noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import Akima1DInterpolator, CubicHermiteSpline

from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.logs.columns import names_of
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import NORMAL, Run, filled, median, position_noise, slope, summed
from automarine_cli.text import listed

MIN_VELOCITIES = 8  # Readings of a velocity that is compared


def unbiased_velocity(run: Run) -> Floats | None:
    """Return the velocity, (N,), less its bias against the position; NaN without a reading, None for hardly any."""
    velocity = run.extras.get(run.dof.velocity)
    if velocity is None or np.isfinite(velocity).sum() < MIN_VELOCITIES:
        return None
    good = np.isfinite(velocity)
    drift, _ = slope(run.time[good], summed(run.time[good], velocity[good]) - run.position[good])
    return np.asarray(velocity - drift)


def velocity_noise(run: Run) -> float:
    """Noise of the velocity logged, apart from any model; zero where there is none."""
    velocity = run.extras.get(run.dof.velocity, np.zeros(0))
    good = np.isfinite(velocity)
    return position_noise(run.time[: len(velocity)][good], velocity[good])


SEGMENT_LENGTHS = (16, 32, 128)  # Samples of a segment of the spectra: filters of different length show in each
MIN_SEGMENTS, MIN_SEGMENTS_OF_OCTAVES = 10, 24  # Segments of a spectrum, and from which on single octaves can be told
CHANCE_COHERENCE = 9.0  # coherence in a bin, times the overlapping segments, that chance exceeds in one of a thousand
NOISE_BAND_RATIO = 1.6  # Where its spectrum is no more than so many times the lowest, the position is noise
ARITHMETIC_NOISE = 1e-6  # Of positions [rad or m]; what is less is arithmetic


def noise_followed(pairs: Sequence[tuple[Floats, Floats]]) -> float | None:
    """Return the share of a velocity's power that the position's noise explains through any linear filter, in the
    octave where it is largest among the frequencies where the position is only noise; None where that cannot be told.

    Spectra of third differences of the position and second ones of the velocity, over the quieter half of the
    segments."""
    rough = [(np.diff(position, 3), np.diff(velocity, 2)) for position, velocity in pairs]
    return max((share for size in SEGMENT_LENGTHS if (share := _coherence(rough, size)) is not None), default=None)


def _coherence(rough: Sequence[tuple[Floats, Floats]], size: int) -> float | None:
    """The same from segments of `size` samples of the differences (Welch's method), less what chance would explain."""
    pairs = [(a[i : i + size], b[i : i + size]) for a, b in rough for i in range(0, len(a) - size + 1, size // 2)]
    if len(pairs) < 2 * MIN_SEGMENTS:
        return None
    pairs.sort(key=lambda pair: float(pair[0] @ pair[0]))
    quiet = np.array(pairs[: len(pairs) // 2])
    window, inner = np.hanning(size), np.arange(1, size // 2)
    first, second = np.moveaxis(np.fft.rfft(window * quiet, axis=2)[..., inner], 1, 0)
    turn = np.abs(1.0 - np.exp(-2j * np.pi * inner / size)) ** 2
    of_position, of_velocity = (np.abs(first) ** 2).mean(axis=0), (np.abs(second) ** 2).mean(axis=0)
    across = np.abs((first * second.conj()).mean(axis=0)) ** 2
    position = of_position / turn**3
    floor = np.sort(position)[: size // 8].mean()
    if floor <= ARITHMETIC_NOISE**2 * float(window @ window):
        return None
    noise = position <= NOISE_BAND_RATIO * floor
    power, explained = of_velocity / turn**2, across / np.maximum(of_position, 1e-300) / turn**2
    octaves = [noise]
    if len(quiet) >= MIN_SEGMENTS_OF_OCTAVES:
        octaves = [noise & (inner >= low) & (inner < 2 * low) for low in 2 ** np.arange(int(np.log2(size)) - 1)]
    shares = []
    for octave in octaves:
        if power[octave].sum() > 0:
            chance = CHANCE_COHERENCE / (len(quiet) * np.sqrt(octave.sum()))
            shares.append(float(explained[octave].sum() / power[octave].sum() - chance))
    return max(shares, default=None)


MAX_STRETCH_S = 20.0  # Longer runs are cut up, for biases wander
MIN_STRETCH_SAMPLES = 12
MIN_STRETCHES, MAX_COMPARED = 3, 200  # Stretches whose scatter tells anything, and that are looked at, evenly
RESPONSE_PASSES = 3  # Until jumps of the acceleration and the sums that allow for them agree
LATE_SAMPLES = range(6)  # By how many samples commands may act late, where jumps of the acceleration are looked for
STRETCH_GAP = 3.0  # Sample periods; a longer hole parts two stretches
MIN_WAY_VELOCITY_NOISE, MIN_WAY_POSITION_NOISE = 5.0, 2.0  # times what noise makes of sums and positions
MAX_CLOCK_LAG_S = 5.0  # Clocks are not looked at further apart
COARSE_DELAYS, FINE_DELAYS = 60, 40  # Tried to either side: first over all, then between neighbours of the best
MAX_LOG_SCALE = np.log(1.5)  # Scales this near to one, as a logarithm, may be those of a sensor whose clock is off
DELAY_RESAMPLES = 200  # Of the stretches, for the doubt of a delay
STUCK_SHARE = 0.8  # Of one exact reading, from which on a sensor is stuck where the position goes elsewhere
MIN_BEND = 0.04  # Share of all its way by which a position then leaves a straight line


@dataclass(frozen=True)
class Stretch:
    """Samples of a run in which both sensors read, (n,) each; time since the first [s], and the `command`, zero where
    none is logged. `way_noise` is the velocity's noise in one sample [rad or m], whose sum is a random walk."""

    time: Floats
    position: Floats
    velocity: Floats
    summed: Floats
    command: Floats
    period: float
    position_noise: float
    way_noise: float


@dataclass(frozen=True)
class SampledResponse:
    """What accelerates a vehicle between samples, by least squares on commands and velocities: `before` and `after`
    times the commands at an interval's begin and end, `late` samples later, and drag. The first acts for the share
    `before` of both, then the acceleration jumps."""

    late: int = 0
    before: float = 0.0
    after: float = 0.0
    linear: float = 0.0
    quadratic: float = 0.0

    @classmethod
    def fitted(cls, parts: Sequence[Stretch]) -> "SampledResponse":
        """Fit all stretches together, with the lateness of commands that leaves the least."""
        pulls = np.concatenate([np.diff(part.velocity) / np.diff(part.time) for part in parts])
        acting = [
            np.concatenate([_acting(part.command, np.diff(part.summed) / np.diff(part.time), late) for part in parts])
            for late in LATE_SAMPLES
        ]
        fits = [np.linalg.lstsq(terms, pulls)[0] for terms in acting]
        late = int(np.argmin([np.square(pulls - terms @ fit).sum() for terms, fit in zip(acting, fits)]))
        return cls(late, *map(float, fits[late]))

    @property
    def share(self) -> float:
        gain = self.before + self.after
        return float(np.clip(self.before / gain, 0.0, 1.0)) if gain else 0.0

    def pull(self, command: Floats) -> Floats:
        return (self.before + self.after) * _held_back(command, self.late)

    def drag(self, velocity: Floats) -> Floats:
        return (self.linear + self.quadratic * np.abs(velocity)) * velocity

    def summed(self, part: Stretch) -> Floats:
        """Give the sums of a stretch, past jumps of the acceleration: straight lines between readings miss them.

        A sum of readings P apart is too large by P²/12 of the acceleration (Euler-Maclaurin), less P² (1/12 - s (1 -
        s)/2) of each jump at the share s of an interval. With jumps of the command this is P² (s (1 - s)/2 of what the
        command gives, less 1/12 of what the drag takes), and the latter looks like a delay of P²/(12 T) of a vehicle
        that answers within T."""
        jumped = 0.5 * self.share * (1.0 - self.share) * self.pull(part.command)
        return np.asarray(part.summed - part.period**2 * (jumped + self.drag(part.velocity) / 12.0))

    def continued(self, run: Run, velocity: Floats, ahead: float) -> Floats:
        """Give velocities (N,) `ahead` [s] later: what accelerates is summed, and the rest, in which nothing jumps, is
        shifted by its spectrum."""
        time, command = run.time, 0.0 * run.time if run.moment is None else run.command
        switches = np.concatenate([time[:1], time[:-1] + self.share * np.diff(time), time[-1:] + ahead])
        pushed = np.append(0.0, np.cumsum(self.pull(command) * np.diff(switches)))
        drag = self.drag(velocity)
        slowed = summed(time, drag)
        now = np.interp(time, switches, pushed) + slowed
        later = np.interp(time + ahead, switches, pushed) + _way_at(time + ahead, time, slowed, drag)
        return np.asarray(advanced(velocity - now, ahead / run.sample_period) + later)


def _acting(command: Floats, velocity: Floats, late: int) -> Floats:
    """What accelerates in each interval, (n - 1, 4): commands at its begin and end, `late` samples later, and drag of
    its mean velocity (n - 1,)."""
    command = _held_back(command, late)
    return np.stack([command[:-1], command[1:], velocity, velocity * np.abs(velocity)], axis=1)


def _held_back(command: Floats, samples: int) -> Floats:
    return np.append(np.full(samples, command[0]), command[: len(command) - samples])


@dataclass(frozen=True)
class Agreement:
    """What `moving` stretches say of a velocity sensor: `correlation` of its sum with the position; `scale` and `late`
    [s] with standard errors, and whether the `clock` explains more than the scale; `period` [s] of the slower sensor;
    `follows`: see `noise_followed`; `stuck`: runs in which it repeats this value while the vehicle moves; `response`:
    how velocities go on from sample to sample."""

    moving: int = 0
    correlation: float = 0.0
    scale: float = 1.0
    scale_error: float = np.inf
    late: float = 0.0
    late_error: float = np.inf
    clock: bool = False
    period: float = 0.0
    follows: float | None = None
    stuck: Mapping[str, float] = field(default_factory=dict)
    response: SampledResponse = SampledResponse()


def agreement(runs: Sequence[Run]) -> Agreement:
    """Compare the velocities of runs with their positions, where they have both."""
    parts, stuck = list[Stretch](), dict[str, float]()
    for run in runs:
        readings = run.extras.get(run.dof.velocity)
        if readings is None or run.summed_up or np.isfinite(readings).sum() < MIN_STRETCH_SAMPLES:
            continue
        if (value := _stuck_at(run, readings)) is not None:
            stuck[run.name] = value
        else:
            parts += stretches(run, readings)
    if len(parts) > MAX_COMPARED:
        parts = [parts[i] for i in np.linspace(0, len(parts) - 1, MAX_COMPARED).astype(int)]
    response, uncorrected = SampledResponse(), parts
    for _ in range(RESPONSE_PASSES if parts else 0):
        response = SampledResponse.fitted(parts)
        parts = [replace(part, summed=response.summed(part)) for part in uncorrected]
    follows = noise_followed([(part.position, part.velocity) for part in parts])
    nothing = Agreement(follows=follows, stuck=stuck, response=response)
    going = [part for part in parts if _goes(part)]
    if not going:
        return nothing
    correlation, scale, _ = _scale(going, 0.0, line=False)
    moving = [part for part in parts if _moves(part, abs(scale))]
    if len(moving) < MIN_STRETCHES:
        return replace(nothing, moving=len(parts), correlation=correlation, scale=scale)
    fixed = 1.0 if abs(np.log(max(scale, 1e-9))) < MAX_LOG_SCALE else None
    late, late_error, misfit = _delay(moving, fixed)
    of_scale = _scale(moving, 0.0 if fixed else late)
    clock = fixed is None or misfit < float(_misfit(moving, np.zeros(1), None).sum())
    period = max(_pace(moving, "position"), _pace(moving, "velocity"))
    # a small scale alone looks like a small delay, and the other way round
    if fixed and max(abs(of_scale[1] - 1.0) / of_scale[2], abs(late) / late_error) > FAULT_STDERRS:
        apart, error, _ = _delay(moving, None)
        if -MAX_SHIFT_PERIODS * period <= apart <= MIN_DELAY_PERIODS * period:
            late, late_error, of_scale = apart, error, _scale(moving, apart)
    return Agreement(len(moving), *of_scale, late, late_error, clock, period, follows, stuck, response)


def stretches(run: Run, readings: Floats) -> list[Stretch]:
    """The parts of a run in which both sensors read without a hole."""
    rows = np.flatnonzero(np.isfinite(readings))
    steps, clock = np.diff(run.time[rows]), run.time[rows] - run.time[rows[0]]
    period = median(steps)
    part = np.concatenate([[0], np.cumsum(steps > STRETCH_GAP * period)]) * 1000.0
    part += np.floor(clock / max(MAX_STRETCH_S, MIN_STRETCH_SAMPLES * period))
    parts = []
    for chosen in np.split(rows, np.flatnonzero(np.diff(part)) + 1):
        if len(chosen) >= MIN_STRETCH_SAMPLES:
            time, position, velocity = run.time[chosen] - run.time[chosen[0]], run.position[chosen], readings[chosen]
            noise, way_noise = position_noise(time, position), position_noise(time, velocity) * period
            command = 0.0 * time if run.moment is None else run.command[chosen]
            parts.append(Stretch(time, position, velocity, summed(time, velocity), command, period, noise, way_noise))
    return parts


def _stuck_at(run: Run, readings: Floats) -> float | None:
    """The value that the sensor repeats while the position leaves a straight line; or None."""
    values, counts = np.unique(readings[np.isfinite(readings)], return_counts=True)
    at, way = float(values[counts.argmax()]), float(np.ptp(run.position))
    same = readings == at
    if way < max(run.dof.limits.unmoved, 5.0 * run.noise) or counts.max() < STUCK_SHARE * counts.sum():
        return None
    return at if np.ptp(_freed(run.time[same], run.position[same])) > max(5.0 * run.noise, MIN_BEND * way) else None


def _freed(time: Floats, values: Floats, *, line: bool = True) -> Floats:
    """Values (..., n) less their mean, and less the straight line through them."""
    less_mean = values - values.mean(axis=-1, keepdims=True)
    if not line:
        return np.asarray(less_mean)
    centred = time - time.mean()
    return np.asarray(less_mean - (values @ centred / float(centred @ centred))[..., None] * centred)


def _goes(part: Stretch) -> bool:
    """Whether the position goes anywhere, as if no sensor had a bias worth the name: good for signs and units."""
    power, square, count = part.position.var(), part.summed.var(), len(part.time)
    drift = part.way_noise**2 * count / 6.0  # of a sum of noise, less its mean
    least = MIN_WAY_VELOCITY_NOISE**2
    return bool(power > least * part.position_noise**2 and max(square, power) > least * drift)


def _moves(part: Stretch, scale: float) -> bool:
    """By the position alone: chosen by the sum itself, those would be told of in which its noise adds to the motion."""
    wander = (scale * part.way_noise) ** 2 * len(part.time) / 15.0  # of a sum of noise, less a line
    least = max(MIN_WAY_VELOCITY_NOISE**2 * wander, MIN_WAY_POSITION_NOISE**2 * part.position_noise**2)
    return bool(np.mean(_freed(part.time, part.position) ** 2) > least)


def _ahead(part: Stretch, delays: Floats) -> Floats:
    """The summed velocities read `delays` (k,) later, (k, n); beyond the ends they go on as there."""
    return _way_at(part.time + delays[:, None], part.time, part.summed, part.velocity)


def _way_at(at: Floats, time: Floats, way: Floats, velocity: Floats) -> Floats:
    """The way at other times than the velocity, of any shape, by both; beyond the ends as fast as about there. Straight
    lines between the samples would make a motion smaller."""
    edge, inside = max(3, min(8, len(time) // 4)), np.clip(at, time[0], time[-1])
    beyond = np.where(at < time[0], np.median(velocity[:edge]), np.median(velocity[-edge:])) * (at - inside)
    return np.asarray(CubicHermiteSpline(time, way, velocity)(inside) + beyond)


def _misfit(moving: Sequence[Stretch], delays: Floats, scale: float | None) -> Floats:
    """Minus log likelihood of each stretch at each delay (stretches, delays); `scale` None: the stretch's own."""
    rows = []
    for part in moving:
        position, summed = _freed(part.time, part.position), _freed(part.time, _ahead(part, delays))
        across, square = summed @ position, (summed**2).sum(axis=1)
        slope = across / np.maximum(square, 1e-300) if scale is None else scale
        residual = position @ position - 2.0 * slope * across + slope**2 * square
        least = len(part.time) * max(part.position_noise, 1e-9) ** 2
        rows.append(0.5 * len(part.time) * np.log(np.maximum(residual, 0.0) + 0.1 * least))
    return np.array(rows)


def _delay(moving: Sequence[Stretch], scale: float | None) -> tuple[float, float, float]:
    """How late the velocity is [s], the standard error of that over stretches, and the misfit that it leaves."""
    step = min(MAX_CLOCK_LAG_S, median(np.array([part.time[-1] for part in moving])) / 3.0) / COARSE_DELAYS
    coarse = np.asarray(step * np.arange(-COARSE_DELAYS, COARSE_DELAYS + 1), dtype=np.float64)
    best = coarse[_misfit(moving, coarse, scale).sum(axis=0).argmin()]
    fine = best + 2.0 * step * np.arange(-FINE_DELAYS, FINE_DELAYS + 1) / FINE_DELAYS
    misfit, count = _misfit(moving, fine, scale), len(moving)
    total = misfit.sum(axis=0)
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1.0 / count), DELAY_RESAMPLES)
    again = np.array([_lowest(fine, row) for row in drawn @ misfit])
    error = float(max(again.std() * np.sqrt(count / (count - 1)), 0.1 * step / FINE_DELAYS))
    return _lowest(fine, total), error, float(total.min())


def _lowest(at: Floats, values: Floats) -> float:
    """Where a parabola through the lowest of `values` (N,) and its neighbours is lowest."""
    i = int(np.clip(values.argmin(), 1, len(at) - 2))
    before, middle, after = values[i - 1 : i + 2]
    bend = before - 2.0 * middle + after
    return float(at[i] + (0.5 * (before - after) / bend if bend > 0 else 0.0) * (at[1] - at[0]))


def _scale(parts: Sequence[Stretch], late: float, *, line: bool = True) -> tuple[float, float, float]:
    """Correlation that four of five stretches reach; median scale, less a `line` or means; its standard error."""
    products = []
    for part in parts:
        position = _freed(part.time, part.position, line=line)
        summed = _freed(part.time, _ahead(part, np.array([late]))[0], line=line)
        raw, power = float(summed @ summed), float(position @ position)
        noise = (part.way_noise * len(part.time)) ** 2 / 15.0 if line else 0.0
        square = max(raw - noise, 0.5 * raw, 1e-12 * power)
        wander = np.cumsum(summed[::-1])[::-1]  # of a sum of noise, by the noise of each sample
        doubt = part.position_noise**2 * raw + part.way_noise**2 * float(wander @ wander)
        products.append((float(summed @ position), square, power, doubt))
    across, squares, powers, doubts = np.array(products).T
    slopes, weights = across / squares, powers / powers.sum()
    correlations = across / np.sqrt(squares * powers)
    middle = _weighted_quantile(correlations, weights, 0.5)
    least = _weighted_quantile(correlations, weights, 0.2 if middle > 0 else 0.8)
    scale = _weighted_quantile(slopes, weights, 0.5)
    scatter = NORMAL * _weighted_quantile(np.abs(slopes - scale), weights, 0.5) * np.sqrt((weights**2).sum())
    error = 1.2533 * float(max(scatter, np.sqrt((weights**2 * doubts / squares**2).sum())))
    return least if least * middle > 0 else 0.0, scale, error


def _weighted_quantile(values: Floats, weights: Floats, share: float) -> float:
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
MAX_FOLLOWED = 0.3  # Share of a velocity's noise that is the position's, beyond which it counts as computed from that
MIN_CORRELATION = 0.7  # Of either sign, of velocity and position below which they are of different motions
MIN_BIASED_CORRELATION = 0.9  # The same where the vehicle hardly changed its velocity, and a bias may hide in it
MIN_SCALE_ERROR = 0.03  # What is less is none: tilt, deviation and the sums of slow loggers make it
MIN_DELAY_PERIODS = 1.5  # Delay that is none, in times between readings
MAX_SHIFT_PERIODS = 0.5  # By which a position may be late for its sensor, in times between readings; effects have more
HELD_PERIODS = 1.5  # Samples between new readings from which on a sensor is slower than the log
FAULT_STDERRS = 5.0
UNIT_RATIO = 1.25  # A scale this near to that of a mistaken unit, as a factor, is that


@dataclass(frozen=True)
class ChannelVerdict:
    """One sensor: whether it is `used`, and a sentence why not, or what is odd about it (else empty)."""

    quantity: str
    used: bool
    why: str = ""


@dataclass(frozen=True)
class ChannelChoice:
    """The sensors of a campaign: `names` that count (None: no choice), `stuck` runs without their velocity; of the
    others it is put right by the `scale` and by how `late` [s] it is against the position; where the position is late
    (below zero), that is put right: commands come before both."""

    verdicts: tuple[ChannelVerdict, ...] = ()
    names: tuple[str, ...] | None = None
    stuck: frozenset[str] = frozenset()
    scale: float = 1.0
    late: float = 0.0
    response: SampledResponse = SampledResponse()

    def cleaned(self, run: Run) -> Run:
        """The run without readings of a sensor that is stuck in it, and those of another put right."""
        return _without_velocity(run) if run.name in self.stuck else self._corrected(run)

    def believed(self, run: Run) -> Run:
        """The run without a velocity that does not count, if only some sensors do, or with it put right."""
        counts = self.names is None or (run.dof.velocity in self.names and run.name not in self.stuck)
        return self._corrected(run) if counts else _without_velocity(run)

    def _corrected(self, run: Run) -> Run:
        readings = run.extras.get(run.dof.velocity)
        if readings is None or (self.scale == 1.0 and self.late == 0.0):
            return run
        readings, position = self.scale * readings, run.position
        if self.late > 0.0:
            later = self.response.continued(run, filled(run.time, readings), self.late)
            readings = np.where(np.isfinite(readings), later, np.nan)
        elif self.late < 0.0 and not run.summed_up:
            way = Akima1DInterpolator(run.time, filled(run.time, readings), extrapolate=True).antiderivative()
            position = position + way(run.time) - way(run.time + self.late)
        return replace(run, position=position, extras={**run.extras, run.dof.velocity: readings})


def advanced(readings: Floats, samples: float) -> Floats:
    """Give readings (N,) a share of a sample later, by their spectrum: their noise stays as white and as large."""
    line = np.linspace(readings[0], readings[-1], len(readings))
    mirrored = np.concatenate([readings - line, (line - readings)[-2:0:-1]])
    turned = np.exp(2j * np.pi * samples * np.fft.rfftfreq(len(mirrored)))
    shifted = np.fft.irfft(turned * np.fft.rfft(mirrored), len(mirrored))[: len(readings)]
    return np.asarray(shifted + line + samples * (line[-1] - line[0]) / (len(line) - 1))


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


def choose_channels(runs: Sequence[Run], dof: Dof, which: str = AUTO, *, late_position: bool = False) -> ChannelChoice:
    """Judge the sensors of all runs and choose: "auto" every one that agrees with the position and adds information,
    "position", "all", or names with commas between. With `late_position` a late position is no contradiction. Raises
    SettingError for a sensor that no log holds."""
    names = parse_channels(which, dof)
    has_velocity = any(np.isfinite(run.extras.get(dof.velocity, np.nan)).any() for run in runs)
    logged = {dof.position: any(not run.summed_up for run in runs), dof.velocity: has_velocity}
    lacking = next((name for name in dof.channels if name in (names or ()) and not logged[name]), None)
    if lacking and runs:
        what, columns = lacking.replace("_", " "), ", ".join(names_of(lacking))
        raise SettingError(f"channels is {which!r}, and no log holds {what}; name its column {columns} with --columns")
    if not has_velocity:
        return NOTHING_TO_CHOOSE
    sensors, not_named = agreement(runs), "It was not asked for (--channels)."
    trouble = trouble_of(sensors, dof, late_position) if logged[dof.position] else ""
    position = logged[dof.position] and (names is None or dof.position in names)
    velocity = dof.velocity in names if names else which == ALL or not trouble
    why, of_position, scale, late = trouble, "" if position else not_named, 1.0, 0.0
    if names and not velocity:
        why = not_named
    elif velocity and not trouble:
        why = _stuck_in(sensors, dof)
        scale, late = _small_errors(sensors, runs) if position else (1.0, 0.0)
        why = " ".join(filter(None, [why, _says_corrected(scale, late, dof)]))
    if not logged[dof.position]:
        words = dof.words
        of_position = f"The logs hold no {words.position}: that shown is a sum of the {words.rate}, and no evidence."
    verdicts = (ChannelVerdict(dof.position, position, of_position), ChannelVerdict(dof.velocity, velocity, why))
    counted, stuck = tuple(v.quantity for v in verdicts if v.used), frozenset(sensors.stuck)
    return ChannelChoice(verdicts, counted, stuck, scale, late, sensors.response)


def _small_errors(sensors: Agreement, runs: Sequence[Run]) -> tuple[float, float]:
    """Scale and lateness [s] of a velocity, too small to speak against it, that are beyond doubt: 1 and 0 if not.

    A hundredth of a scale or a third of a sample looks like an effect where both sensors count; no effect makes a
    velocity late by more. A sensor slower than the log is late because its readings are held."""
    sampled = median(np.array([run.sample_period for run in runs]))
    late = sensors.late if abs(sensors.late) > FAULT_STDERRS * sensors.late_error else 0.0
    scale = sensors.scale if abs(sensors.scale - 1.0) > FAULT_STDERRS * sensors.scale_error else 1.0
    shifted = -MAX_SHIFT_PERIODS * sampled <= late <= MIN_DELAY_PERIODS * sampled
    within = abs(scale - 1.0) <= MIN_SCALE_ERROR and shifted
    return (scale, late) if within and sensors.period <= HELD_PERIODS * sampled else (1.0, 0.0)


def _says_corrected(scale: float, late: float, dof: Dof) -> str:
    """Say what of two sensors is put right; empty for nothing."""
    sentences, rate, position = [], dof.words.rate, dof.words.position
    if scale != 1.0:
        size = f"{100 * abs(1 / scale - 1):.2g} % {'less' if scale > 1 else 'more'}"
        sentences.append(f"The {rate} reads {size} than the {position}")
    if late != 0.0:
        first, second = (rate, position) if late > 0 else (position, rate)
        sentences.append(f"The {first} is {abs(late):.2g} s late against the {second}")
    return " ".join(f"{sentence}: it is put right." for sentence in sentences)


def trouble_of(sensors: Agreement, dof: Dof, late_position: bool = False) -> str:
    """A sentence on what speaks against the velocity, with the remedy; empty for nothing."""
    rate, position, column = dof.words.rate, dof.words.position, names_of(dof.velocity)[0]
    correlation, scale = sensors.correlation, sensors.scale
    if sensors.follows is not None and sensors.follows > MAX_FOLLOWED:
        return (
            f"The {rate} was computed from the {position}, or both come out of one estimator "
            f"({100 * sensors.follows:.0f} % of its noise is that of the {position}): it adds no information."
        )
    if not sensors.moving:
        return _stuck_in(sensors, dof)
    if abs(correlation) < MIN_CORRELATION:
        return (
            f"The {rate} does not follow the {position} (correlation {correlation:.2f}): it is of another motion or "
            f"another time; check which column is meant by {column}."
        )
    if abs(correlation) < MIN_BIASED_CORRELATION and not np.isfinite(sensors.scale_error):
        return ""
    unit, rule = _mistaken_unit(abs(scale), dof)
    if scale < 0:
        return (
            f"The {rate} has the wrong sign (correlation {correlation:.2f} of its sum with the {position})"
            f"{unit and f', and {unit}'}; map it with sign = -1{rule and f' and {rule}'} in the --columns file."
        )
    if unit:
        return f"The {rate} {unit}; map it with {rule} in the --columns file."
    off = abs(scale - 1.0) > max(MIN_SCALE_ERROR, FAULT_STDERRS * sensors.scale_error)
    late = abs(sensors.late) > max(MIN_DELAY_PERIODS * sensors.period, FAULT_STDERRS * sensors.late_error)
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
    if dof.angular:
        units = {dof.units.per_base: (f"{base}, not in {log}", f'unit = "{base}"'),
                 1 / dof.units.per_base: (f"{log}, not in {base}", f'unit = "{log}"')}  # fmt: skip
    for factor, (unit, rule) in units.items():
        if abs(np.log(size / factor)) < np.log(UNIT_RATIO):
            times = f"{names_of(dof.velocity)[0]}: {1 / size:.3g} times what the {dof.words.position} moves"
            return f"is in {unit} ({times})", rule
    return "", ""


def _stuck_in(sensors: Agreement, dof: Dof) -> str:
    if not sensors.stuck:
        return ""
    value = f"{float(dof.logged(median(np.array([*sensors.stuck.values()])))):.4g} {dof.units.log}/s"
    where = listed(sensors.stuck) if sensors.moving else "every run"
    return (
        f"The {dof.words.rate} is stuck at {value} in {where} while the {dof.words.position} moves, and left out "
        "there; check the sensor and its cable."
    )
