"""What differs from run to run and is no property of the vehicle, by name: the random effects of the mixed model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.quantities import Floats

START_POSITION, START_VELOCITY, GAIN = "start-position", "start-velocity", "gain"
SWITCHES, DISTURBANCE = "switch-instants", "disturbance"


def bias_of(channel: str) -> str:
    """Name of the constant that a channel adds to its readings in each run."""
    return f"{channel}-bias"


@dataclass(frozen=True)
class Block:
    """Run effects of one kind before the data: standard deviations `scale` (R, k), where they have `limits` times one
    estimated factor within these."""

    name: str
    scale: Floats
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class RunEffects:
    """What is known of the q run effects b_i before the data, kind by kind."""

    blocks: tuple[Block, ...]

    @cached_property
    def scale(self) -> Floats:
        """Standard deviations, (R, q), before any factor."""
        return np.concatenate([block.scale for block in self.blocks], axis=1)

    @cached_property
    def factor_names(self) -> tuple[str, ...]:
        """The blocks that have a factor, in the order of the factors."""
        return tuple(block.name for block in self.blocks if block.limits is not None)

    @cached_property
    def limits(self) -> tuple[tuple[float, float], ...]:
        """(lower, upper) of each factor."""
        return tuple(block.limits for block in self.blocks if block.limits is not None)

    @cached_property
    def _factor(self) -> NDArray[np.int64]:
        """Index of the factor that multiplies each effect, -1 for none."""
        of = {name: i for i, name in enumerate(self.factor_names)}
        return np.array([of.get(block.name, -1) for block in self.blocks for _ in range(block.scale.shape[1])])

    @cached_property
    def _columns(self) -> dict[str, slice]:
        ends = np.cumsum([block.scale.shape[1] for block in self.blocks]).tolist()
        return {b.name: slice(end - b.scale.shape[1], end) for b, end in zip(self.blocks, ends)}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the blocks in their order."""
        return tuple(block.name for block in self.blocks)

    def has(self, name: str) -> bool:
        """Whether there is a block of that name."""
        return name in self._columns

    def of(self, b: Floats, name: str) -> Floats:
        """The run effects (..., k) of one block out of all, b (..., q); a view."""
        return b[..., self._columns[name]]

    def only(self, b: Floats, names: Sequence[str]) -> Floats:
        """b (..., q) with every block but those named at zero."""
        kept = np.zeros_like(b)
        for name in names:
            if self.has(name):
                self.of(kept, name)[...] = self.of(b, name)
        return kept

    def carried(self, b: Floats, other: "RunEffects") -> Floats:
        """Run effects b (R, q) of these blocks as those of `other`: blocks that only one of them has are zero there."""
        out = np.zeros_like(other.scale)
        for name in self.names:
            if other.has(name) and other.of(out, name).shape == self.of(b, name).shape:
                other.of(out, name)[...] = self.of(b, name)
        return out

    def with_scale(self, **scales: Floats | float) -> "RunEffects":
        """The same with other standard deviations of some blocks, by name with underscores."""
        new = {name.replace("_", "-"): value for name, value in scales.items()}
        return RunEffects(
            tuple(
                replace(block, scale=np.zeros_like(block.scale) + new[block.name]) if block.name in new else block
                for block in self.blocks
            )
        )

    def deviation(self, variances: Floats) -> Floats:
        """Standard deviations (R, q) for the variances."""
        factors = variances[len(variances) - len(self.limits) :]
        return self.scale * np.append(np.exp(factors), 1.0)[self._factor]

    @cached_property
    def members(self) -> Floats:
        """Which effects each factor multiplies, (factors, q): one where it does."""
        return np.array(self._factor == np.arange(len(self.limits))[:, None], dtype=float)
