"""The search for what a model lacks, whatever the model is of and however its candidates are judged.

Forward: look what every candidate would gain and what chance would, fit the leaders, add the best that may stand, look
again. Backward: take each effect out in turn and look again: what does better in its place is put there, what nothing
asks for any more stays out, and what else could stand there is known as its rivals. (Stepwise selection: Efroymson
1960, in Mathematical methods for digital computers; here with a threshold for the best of all candidates.)
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from automarine_cli.errors import FitError
from automarine_cli.quantities import Floats

Candidate = TypeVar("Candidate")
Round = TypeVar("Round", bound=Any)
"""One look for a missing effect; `before` is the model that was looked at, perhaps fitted better than it came."""


@dataclass(frozen=True)
class Chance:
    """What the best of all candidates gains where nothing is missing: `null`, draws (N,) in the unit of evidence."""

    null: Floats

    def threshold(self, level: float) -> float:
        """Gain that chance reaches in a share `level` of all cases."""
        return float(np.quantile(self.null, 1.0 - level))

    def p_value(self, gain: float) -> float:
        """Share of cases without a missing effect whose best candidate would gain as much."""
        return float((1 + np.sum(self.null >= gain)) / (1 + len(self.null)))


class Judge(ABC, Generic[Candidate, Round]):
    """What a search asks about one kind of model. A new kind says how to look and who may be added; one that says too
    what `added` lists and how to do `without` an effect has its effects reconsidered, and knows their rivals."""

    most: int  # looks forward

    @abstractmethod
    def look(self, model: Candidate, number: int) -> Round:
        """Score all candidates, fit the leaders; `number` counts the looks of a search, for what is drawn at random.

        Raises FitError where it cannot be done."""

    @abstractmethod
    def admissible(self, look: Round, first: Round) -> Sequence[Candidate]:
        """Models with one effect more that are beyond chance and may stand, the best first; `first` was the first look
        of the search."""

    def full(self, model: Candidate) -> bool:
        return False

    def added(self, model: Candidate) -> tuple[str, ...]:
        """The effects that were added to a model, those that are to be reconsidered."""
        return ()

    def alone(self, model: Candidate) -> bool:
        """Whether what was added competed with all others in the first look."""
        return len(self.added(model)) < 2

    def without(self, model: Candidate, name: str) -> Candidate | None:
        """The model with one effect taken out, fitted again; None where there is no such fit."""
        return None

    def better(self, current: Candidate, reduced: Candidate, look: Round, first: Round) -> Candidate:
        """What is best: `current`, what the `look` at `reduced` (current without one effect) found, or `reduced`."""
        return current


@dataclass(frozen=True)
class Outcome(Generic[Candidate, Round]):
    """The final model, the looks forward, and for each effect added the look in which others competed for its place."""

    final: Candidate
    looks: tuple[Round, ...]
    around: dict[str, Round]


@dataclass(frozen=True)
class NamedRival:
    """Another explanation that the data cannot exclude, its weight, and the run or pull that would tell."""

    name: str
    confidence: float
    split_by: str
    label: str = ""  # the name with what it adds, where the name alone does not tell

    @property
    def title(self) -> str:
        return self.label or self.name


def stepwise_search(
    judge: Judge[Candidate, Round], base: Candidate, goes_on: Callable[[Round], bool] = lambda first: True
) -> Outcome[Candidate, Round]:
    """What `base` lacks; `goes_on` says after a first look that found something whether to go on. Raises FitError where
    not even that look can be made."""
    current, looks = _forward(judge, base, goes_on)
    current, around = _reconsidered(judge, current, looks[0])
    return Outcome(current, tuple(looks), around)


def _forward(
    judge: Judge[Candidate, Round], current: Candidate, goes_on: Callable[[Round], bool]
) -> tuple[Candidate, list[Round]]:
    looks: list[Round] = []
    alternatives: list[Candidate] = []
    while len(looks) < judge.most and not judge.full(current):
        try:
            look = judge.look(current, len(looks))
        except FitError:
            if not looks:
                raise
            if not alternatives:  # neither the last model can be looked at nor any that could stand for it
                return looks[-1].before, looks
            current = alternatives.pop(0)
            continue
        looks.append(look)
        candidates = judge.admissible(look, looks[0])
        if not candidates or (len(looks) == 1 and not goes_on(look)):
            return look.before, looks
        current, *alternatives = candidates
    return current, looks


def _reconsidered(
    judge: Judge[Candidate, Round], current: Candidate, first: Round
) -> tuple[Candidate, dict[str, Round]]:
    """Take each effect out in turn and look again: what was found first may mimic two effects at once, and is then
    better replaced when the other is known. In the place of a single effect competes what the first look found."""
    if judge.alone(current):
        return current, dict.fromkeys(judge.added(current), first)
    around: dict[str, Round] = {}
    waiting, steps = list(judge.added(current)), 0
    while waiting and steps < 3 * judge.most:
        steps += 1
        name = waiting.pop(0)
        reduced = judge.without(current, name)
        if reduced is None:
            continue
        try:
            look = judge.look(reduced, judge.most + steps)
        except FitError:  # this model cannot be asked
            continue
        best = judge.better(current, reduced, look, first)
        if best is current:
            around[name] = look
        else:
            current, around, waiting = best, {}, list(judge.added(best))
    if judge.alone(current):
        around = dict.fromkeys(judge.added(current), first)
    return current, around
