"""Named steps in order, each of which says how many items went in and how many came out.

pipeline = Pipeline(progress)
steps = pipeline.spread("find steps", runs, find_steps)
kept = pipeline.step("trim to half-turns", steps, half_turn)
result["steps"] = pipeline.to_json()
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class StepCount:
    """What one step did: its name, the items that went in and the items that came out."""

    name: str
    items_in: int
    items_out: int

    def __str__(self) -> str:
        return f"{self.name}: {self.items_in} -> {self.items_out}"

    def to_json(self) -> dict[str, object]:
        """The entry under `"steps"` of a result file."""
        return {"step": self.name, "in": self.items_in, "out": self.items_out}


class Pipeline:
    """Runs steps over items and keeps the count; knows nothing of what the items are."""

    def __init__(self, progress: Progress = silent, jobs: int = 1) -> None:
        self._progress = progress
        self._jobs = jobs
        self._counts: list[StepCount] = []

    @property
    def counts(self) -> tuple[StepCount, ...]:
        """What the steps so far did, in order."""
        return tuple(self._counts)

    def step(
        self, name: str, items: Iterable[Item], function: Callable[[Item], Result | None]
    ) -> list[Result]:
        """One result for each item, in order; an item for which `function` returns None is dropped."""
        work = list(items)
        results = ordered_map(function, work, self._jobs, progress=self._progress, stage=name)
        kept = [result for result in results if result is not None]
        self._counts.append(StepCount(name, len(work), len(kept)))
        return kept

    def spread(
        self, name: str, items: Iterable[Item], function: Callable[[Item], Sequence[Result]]
    ) -> list[Result]:
        """Any number of results for each item (the steps of a run), in order in one flat list."""
        work = list(items)
        results = ordered_map(function, work, self._jobs, progress=self._progress, stage=name)
        flat = [result for group in results for result in group]
        self._counts.append(StepCount(name, len(work), len(flat)))
        return flat

    def to_json(self) -> list[dict[str, object]]:
        """The list under `"steps"` of a result file."""
        return [count.to_json() for count in self._counts]
