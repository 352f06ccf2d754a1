"""From a choice of runs to a day at the pool: their order, start headings, waits, and what the battery then holds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.planning.budget import Supply, wait_after
from automarine_cli.planning.candidates import Candidate
from automarine_cli.planning.limits import Limits


@dataclass(frozen=True)
class Slot:
    """One run of the campaign: `number` from 1, `begins` [s] after the first log's start, `wait` [s] after it (none
    after the last), `left` [Ah] in the battery when its log ends."""

    number: int
    candidate: Candidate
    begins: float
    wait: float
    left: float

    @property
    def name(self) -> str:
        """Name of its log."""
        return f"{self.number:02d}_{self.candidate.label}"

    def ends(self, rest: float) -> float:
        """When its log ends [s after the first log's start]."""
        return self.begins + rest + self.candidate.driven


def in_order(chosen: Sequence[Candidate], check: Candidate | None, seed: int) -> list[Candidate]:
    """The runs in random order, those at another voltage last; with `check`, that run first and last."""
    rest = list(chosen)
    if check is not None:
        for _ in range(2):
            rest.remove(check)
    drawn = np.random.default_rng(seed).permutation(len(rest))
    shuffled = sorted((rest[int(i)] for i in drawn), key=lambda one: one.voltage is not None)
    return shuffled if check is None else [check, *shuffled, check]


def scheduled(runs: Sequence[Candidate], limits: Limits, supply: Supply) -> tuple[Slot, ...]:
    """The runs one after the other, start headings in turn; times to the tenth of a second."""
    headings, rest = limits.pool.start_headings_deg, limits.runs.rest_before_s
    clock, left, slots = 0.0, limits.battery.charge_Ah, list[Slot]()
    for i, one in enumerate(runs):
        one = one.at(start_heading=headings[i % len(headings)], clock=round(clock, 1))
        wait = wait_after(one, limits) if i + 1 < len(runs) else 0.0
        left -= supply.drawn(one, rest)
        slots.append(Slot(i + 1, one, one.clock, wait, left))
        left -= supply.idle * wait / 3600.0
        clock += rest + one.driven + wait
    return tuple(slots)


def pool_minutes(slots: Sequence[Slot], rest: float) -> float:
    """From the start of the first log to the end of the last."""
    return slots[-1].ends(rest) / 60.0
