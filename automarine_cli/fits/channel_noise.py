"""Which sensors a result rests on, and how noisy each was."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.fits.outcome import Outcome
from automarine_cli.pipeline.records import to_mapping
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.records import Sensor
from automarine_cli.runs.channels import ChannelChoice, ChannelVerdict
from automarine_cli.runs.noise import position_noise
from automarine_cli.runs.run import Run

ROBUST = 1.65
"""Error of a standard deviation told by a median, over that of the usual one."""


def channel_noises(fit: Outcome, dof: Dof) -> dict[str, Estimate]:
    """Noise of each channel that counts, in the units in which people see it.

    The relative error is that of the standard deviation of so many white residuals.
    """
    found = {}
    for name, noise in fit.noise_of.items():
        count = max(float(fit.read[name]) - len(fit.theta), 1.0)
        unit = dof.units.shown + "/s" * (name == dof.velocity)
        one = Estimate.from_log(float(dof.shown(noise)), 1.0 / np.sqrt(2.0 * count), count, unit)
        bound = f"noise.{name}" in fit.names and fit.names.index(f"noise.{name}") in fit.at_bound
        found[name] = replace(one, at_bound=bound)
    return found


def channels_json(choice: ChannelChoice, fit: Outcome, dof: Dof) -> dict[str, object]:
    """`{"channels": [{"quantity", "used", "noise" or "why"}]}` for a result; {} where only positions are logged."""
    return channels_of(choice, channel_noises(fit, dof) if choice.verdicts else {})


def measured_noises(runs: Sequence[Run], dof: Dof) -> dict[str, Estimate]:
    """Noise of each sensor estimated without a model, pooled over the runs that have it."""
    found = {}
    for name in dof.channels:
        squares, count = 0.0, 0
        for run in runs:
            read = run.channel(name)
            if read is None or (name == dof.position and run.summed_up):
                continue
            good = np.isfinite(read)
            squares += float(good.sum()) * position_noise(run.time[good], read[good]) ** 2
            count += int(good.sum())
        if count:
            unit = dof.units.shown + "/s" * (name == dof.velocity)
            error = ROBUST / np.sqrt(2.0 * count)
            found[name] = Estimate.from_log(float(dof.shown(np.sqrt(squares / count))), error, count, unit)
    return found


def channels_of(choice: ChannelChoice, noises: Mapping[str, Estimate]) -> dict[str, object]:
    """The same with noises that were measured in another way."""
    sensors = [to_mapping(_sensor(one, noises)) for one in choice.verdicts]
    return {"channels": sensors} if sensors else {}


def _sensor(one: ChannelVerdict, noises: Mapping[str, Estimate]) -> Sensor:
    return Sensor(one.quantity, one.used, noises.get(one.quantity) if one.used else None, one.why or None)


def noise_words(fit: Outcome, dof: Dof) -> str:
    """The noises of a fit in a line, such as "heading noise 1.00 deg"."""
    names = {dof.position: dof.words.position, dof.velocity: dof.words.rate}
    noises = channel_noises(fit, dof).items()
    return ", ".join(f"{names[name]} noise {one.value:.2f} {one.unit}{_bound(one)}" for name, one in noises)


def _bound(one: Estimate) -> str:
    return ", at its bound" * one.at_bound


def fit_sentences(choice: ChannelChoice, fit: Outcome, dof: Dof) -> list[str]:
    """`channel_sentences` with the noises of a fit."""
    return channel_sentences(choice, channel_noises(fit, dof), dof)


def channel_sentences(choice: ChannelChoice, noises: Mapping[str, Estimate], dof: Dof) -> list[str]:
    """One line on the sensors that count, and one on each that does not; none where only positions are logged."""
    return sentences_of([_sensor(one, noises) for one in choice.verdicts], dof)


def sentences_of(sensors: Sequence[Sensor], dof: Dof) -> list[str]:
    """The same of the sensors of a result file, if it has any."""
    if not sensors:
        return []
    words, used, lines = {dof.position: dof.words.position, dof.velocity: dof.words.rate}, [], []
    for one in sensors:
        name, noise = words.get(one.quantity, one.quantity), one.noise
        if one.used:
            used.append(name if noise is None else f"{name} (noise {noise.value:.3g} {noise.unit}{_bound(noise)})")
        if one.why:
            lines.append(one.why if one.used else f"The {name} does not count. {one.why}")
    return [f"Sensors that count: {' and '.join(used)}.", *lines]
