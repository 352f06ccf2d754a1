"""A specification becomes plans: one for each run, in the order of the campaign, with its place on the clock."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from automarine_cli.errors import SettingError
from automarine_cli.simulation.run_groups import Commands, Resistance, RunGroup
from automarine_cli.simulation.specification import Specification
from automarine_cli.simulation.streams import uniform

MOST_SAMPLES, MOST_RUNS = 500_000_000, 1_000_000
LETTERS = "abcdefghijklmnopqrstuvwxyz"


@dataclass(frozen=True)
class Plan:
    """One run to be made: `key` names its random streams; `name` its run, `file` its log.

    `samples` are logged; from sample `changes[j]` on `moments[j]` shows in the log, before the first `moments`
    nothing is commanded. `turn` counts the runs of the specification; `start` [s] is the campaign's clock at the
    first sample.
    """

    key: str
    name: str
    file: str
    group: RunGroup
    turn: int
    samples: int
    changes: tuple[int, ...]
    moments: tuple[float, ...]
    start: float = 0.0


def make_plans(specification: Specification, seed: int) -> tuple[Plan, ...]:
    """The plans of all runs in the order in which they are made.

    Raises SettingError for two runs of one name in one file, two groups that write one file, and a campaign of
    more than half a thousand million samples.
    """
    asked = sum(group.repeats for group in specification.runs)  # before any is made: it may be a thousand million
    plans = [] if asked > MOST_RUNS else list(islice(_listed(specification), MOST_RUNS + 1))
    if max(asked, len(plans)) > MOST_RUNS:
        raise SettingError(f"{specification.source}: more than {MOST_RUNS} runs would be made; ask for fewer")
    _refuse_clashes(plans, specification)
    total = sum(plan.samples for plan in plans)
    if total > MOST_SAMPLES:
        raise SettingError(
            f"{specification.source}: {total:.3g} samples would be made; expected at most {MOST_SAMPLES:.0g}. "
            "Ask for fewer or shorter runs, or a lower rate_hz"
        )
    if specification.campaign.order == "random":
        plans.sort(key=lambda plan: float(uniform(1, seed, plan.key, "order")[0]))
    placed, clock = [], 0.0
    for plan in plans:
        placed.append(replace(plan, start=round(clock, 6)))
        wait = specification.campaign.wait_between_s if plan.group.wait_after_s is None else plan.group.wait_after_s
        clock += plan.samples * specification.logger.period + wait
    return tuple(placed)


def _listed(specification: Specification) -> Iterator[Plan]:
    """Plans in the order of the specification, repeats of a run one after the other."""
    vehicle = specification.vehicle
    drag = Resistance(vehicle.inertia, vehicle.linear, vehicle.quadratic, vehicle.dof, vehicle.constant)
    turn = 0
    for group in specification.runs:
        for label, commands in group.cases(drag):
            for repeat in range(group.repeats):
                name = f"{label}_{_letter(group, repeat)}".rstrip("_")
                stem = name if group.together is None else group.together
                samples, changes, moments = _on_the_grid(commands, specification)
                yield Plan(
                    key=f"{group.folder}/{label}#{group.suffix or repeat}",
                    name=name,
                    file=f"{group.folder}/{stem}.{group.format}",
                    group=group,
                    turn=turn,
                    samples=samples,
                    changes=changes,
                    moments=moments,
                )
                turn += 1


def _letter(group: RunGroup, repeat: int) -> str:
    if group.suffix is not None or group.repeats == 1:
        return group.suffix or ""
    return LETTERS[repeat] if group.repeats <= len(LETTERS) else str(repeat + 1)


def _on_the_grid(commands: Commands, specification: Specification) -> tuple[int, tuple[int, ...], tuple[float, ...]]:
    """Number of samples, first sample of each command, the commands: rests included, zeros at the start left
    out.
    """
    schedule, rate = specification.campaign, specification.logger.rate_hz
    whole = ((0.0, schedule.rest_before_s), *commands, (0.0, schedule.rest_after_s))
    ends = np.round(np.cumsum([seconds for _, seconds in whole]) * rate)
    begins, held = np.concatenate([[0.0], ends[:-1]]), 0.0
    changes, moments = [], []
    for (moment, _), begin, end in zip(whole, begins, ends):
        if moment != held and end > begin:
            changes.append(int(begin))
            moments.append(moment)
            held = moment
    return int(ends[-1]), tuple(changes), tuple(moments)


def _refuse_clashes(plans: list[Plan], specification: Specification) -> None:
    runs: set[tuple[str, str]] = set()
    owners: dict[str, tuple[str, int]] = {}
    if specification.bollard is not None:
        owners[specification.bollard.file.lower()] = ("the bollard test", -1)
    for plan in plans:
        if plan.samples < 2:
            raise SettingError(
                f"{specification.source}: run {plan.name!r} has {plan.samples} samples; expected at least 2"
            )
        file = plan.file.lower()  # some file systems do not tell A from a
        several = plan.group.together is not None
        owner = ("one file together", 0) if several else (plan.name, plan.turn)
        if (file, plan.name) in runs or owners.setdefault(file, owner) != owner:
            raise SettingError(
                f"{specification.source}: two runs would be written as {plan.name!r} in {plan.file}; "
                "give one of their groups another name, folder or suffix"
            )
        runs.add((file, plan.name))
