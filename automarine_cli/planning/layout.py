"""Runs on paper as runs to fit: sampled as the logger would, with a heading that is still to be measured."""

from collections.abc import Sequence

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.planning.candidates import Candidate
from automarine_cli.runs.run import Run


def as_run(
    candidate: Candidate,
    dof: Dof,
    *,
    rate: float,
    rest: float,
    unit: str,
    voltage: float | None = None,
    channels: Sequence[str] | None = None,
) -> Run:
    """The run that a logger of `rate` [Hz] would bring home, `rest` [s] of zero moment first; the heading stands still.

    A command shows from the first sample at or after its instant, as in simulated campaigns. `voltage` [V] is the
    usual one, or None where the logs have no such column; of `channels` only a velocity is a column of its own.
    """
    ends = np.round(np.cumsum([rest, *(seconds for _, seconds in candidate.commands)]) * rate).astype(int)
    moment = np.zeros(int(ends[-1]))
    for (level, _), begin, end in zip(candidate.commands, ends[:-1], ends[1:]):
        moment[begin:end] = level
    time = candidate.clock + np.arange(len(moment)) / rate
    heading = np.full(len(moment), np.deg2rad(candidate.start_heading))
    volts = candidate.voltage if candidate.voltage is not None else voltage
    extras = {} if volts is None else {"voltage": np.full(len(moment), volts)}
    if dof.velocity in (channels or ()):
        extras[dof.velocity] = np.zeros(len(moment))
    return Run(candidate.label, "plan", time, heading, moment, unit, extras, dof=dof)


def alike(candidates: Sequence[Candidate]) -> dict[str, list[int]]:
    """Places of the candidates of each kind: laid out together, none is padded to the length of a slow ramp."""
    groups: dict[str, list[int]] = {}
    for place, candidate in enumerate(candidates):
        groups.setdefault(candidate.kind, []).append(place)
    return groups
