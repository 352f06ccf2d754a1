"""What a search for missing effects tries and finds: trials, the rounds they compete in, rivals, and the outcome."""

from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.diagnosis.scores import Scores
from automarine_cli.diagnosis.study import Fit, Study
from automarine_cli.models.yaw_model import BASE_TERMS, YawModel
from automarine_cli.quantities import Floats

LEVEL = 0.005
"""Share of campaigns with nothing missing in which something may still be claimed."""
WEAK = 0.05
"""The same of what is suspected."""
CLEAR = 2.0
"""Standard errors over runs by which runs have to gain in the mean."""
MOST_EFFECTS = 3
STANDS = 1.3
"""Times the floor above which what is left is said, and above which residuals that hang together are unexplained,
however much larger they were before."""


DRAG = BASE_TERMS["2"]
"""Effects that put the drag of the base right."""
CURVE = ("dead-band", "thrust-exponent")
"""What together is the curve of the thrust against its command, and counts as one effect."""


def number_of(added: tuple[str, ...]) -> int:
    """How many effects were added."""
    return len(added) - (set(CURVE) <= set(added))


@dataclass(frozen=True)
class Trial:
    """A model with its fit; `evidence` is in deviance, smaller is better."""

    added: tuple[str, ...]
    model: YawModel
    fit: Fit
    evidence: float

    @property
    def counted(self) -> tuple[str, ...]:
        """The effects added, without what puts the drag of the base right beside others."""
        return tuple(name for name in self.added if not corrects(name)) or self.added


def corrects(name: str) -> bool:
    """Whether an effect puts the drag of the base right."""
    return name in DRAG


@dataclass(frozen=True)
class Round:
    """One round of the search: the scores, every candidate's full fit, and the threshold on the gain in evidence."""

    before: Trial
    scores: Scores
    trials: tuple[Trial, ...]
    threshold: float

    def gain(self, trial: Trial) -> float:
        """Evidence gained over the model that the round began with."""
        return self.before.evidence - trial.evidence


@dataclass(frozen=True)
class Rival:
    """An explanation that the runs cannot exclude: what it replaces, how far behind it is (deviance), its fit."""

    replaces: str
    name: str
    behind: float
    trial: Trial


@dataclass(frozen=True)
class Compensating:
    """Two effects of opposite pull: the correlation of their sizes, and the largest share of what both gain that one of
    them gains alone."""

    names: tuple[str, str]
    correlation: float
    alone: float

    @property
    def says(self) -> str:
        """The sentence for people."""
        first, second = self.names
        return (
            f"{first} and {second} undo each other (correlation {self.correlation:.2f}; alone either gains at most "
            f"{100 * self.alone:.0f}% of what both do): together they may stand for one law that is not in the library."
        )


@dataclass(frozen=True)
class Found:
    """Outcome of a search: the study as judged, base and final model, rounds, p-value of each effect added, rivals.

    `more` says that after MOST_EFFECTS effects another candidate would still beat chance; `doubtful` is the outcome if
    what chance reaches in WEAK of all campaigns were enough, where nothing was added. `crowd` is a sentence where one
    effect took the place of several that had been added, `compensating` has the pairs of final effects of which each
    undoes most of what the other does: neither has earned its name. `equals` is a sentence where runs held out decided
    between laws or sizes.
    """

    study: Study
    base: Trial
    final: Trial
    rounds: tuple[Round, ...]
    p_values: dict[str, float]
    rivals: tuple[Rival, ...]
    more: bool = False
    doubtful: "Found | None" = None
    crowd: str = ""
    compensating: tuple["Compensating", ...] = ()
    equals: str = ""

    @property
    def without_effects(self) -> "Found":
        """The same with nothing added."""
        return replace(self, final=self.base, p_values={}, rivals=(), doubtful=None)

    def weight(self, name: str) -> float:
        """Weight of an effect of the final model against its rivals."""
        others = sum(float(np.exp(-0.5 * rival.behind)) for rival in self.rivals if rival.replaces == name)
        return 1.0 / (1.0 + others)


def clear(gains: Floats, errors: float = CLEAR) -> bool:
    """Whether gains in log density (R,) are more than so many standard errors above nothing in the mean."""
    error = float(np.std(gains, ddof=1)) / np.sqrt(len(gains)) if len(gains) > 1 else np.inf
    return bool(gains.mean() > errors * error)
