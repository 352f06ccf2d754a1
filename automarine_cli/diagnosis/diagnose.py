"""A whole diagnosis: search, verdict, where, gaps on runs fitted and held out, what to run next."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.diagnosis import verdict as judge
from automarine_cli.diagnosis.advice import split_by
from automarine_cli.diagnosis.gap import Gap, gap
from automarine_cli.diagnosis.outlook import Outlook, outlook
from automarine_cli.diagnosis.search import Map, search
from automarine_cli.diagnosis.study import Study, study_of
from automarine_cli.diagnosis.trials import Found
from automarine_cli.diagnosis.verdict import NamedEffect
from automarine_cli.errors import RunError
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.channels import AUTO, NOTHING_TO_CHOOSE, ChannelChoice, choose_channels
from automarine_cli.runs.run import Run

FEWEST_RUNS = 4
FEWEST_TO_HOLD_OUT = 8


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis found; `held_out` and `held_out_gap` are None where too few runs were left to hold any out.

    `why` says what keeps effects that are "suspected" from being named; the outlooks are those of driven runs.
    """

    verdict: str
    study: Study
    found: Found
    effects: tuple[NamedEffect, ...]
    gap: Gap
    held_out: Study | None
    held_out_gap: Gap | None
    detectable: dict[str, float]
    why: str = ""
    outlook: Outlook | None = None
    held_out_outlook: Outlook | None = None
    channels: ChannelChoice = NOTHING_TO_CHOOSE


def split_off(runs: Sequence[Run], seed: int) -> tuple[list[Run], list[Run]]:
    """Runs to fit and a quarter to hold out, spread over the moments: one drawn from every four neighbours in moment.

    All are fitted where there are fewer than FEWEST_TO_HOLD_OUT.
    """
    if len(runs) < FEWEST_TO_HOLD_OUT:
        return list(runs), []
    mean = [
        float(np.mean(run.command[run.command != 0])) if np.any(run.command != 0) else 0.0 for run in runs
    ]
    order = sorted(range(len(runs)), key=lambda i: (mean[i], runs[i].name))
    random = np.random.default_rng(seed)
    out = {order[i + int(random.integers(4))] for i in range(0, len(order) - 3, 4)}
    return [run for i, run in enumerate(runs) if i not in out], [runs[i] for i in sorted(out)]


def diagnose_runs(
    runs: Sequence[Run],
    base: YawModel,
    *,
    hold_out: Sequence[Run] | None = None,
    seed: int = 0,
    each: Map | None = None,
    channels: str = AUTO,
) -> Diagnosis:
    """Diagnose `base` on `runs`; `hold_out` None draws a quarter of the runs, `channels` says which sensors count
    (`runs.channels.choose_channels`). Raises RunError for too few runs."""
    runs = [run for run in runs if len(run) >= 20]
    every = [*runs, *(hold_out or ())]
    chosen = choose_channels(every, base.dof, channels, late_position=True)
    runs = [chosen.cleaned(run) for run in runs]
    hold_out = None if hold_out is None else [chosen.cleaned(run) for run in hold_out]
    fitted, kept = split_off(runs, seed) if hold_out is None else (list(runs), list(hold_out))
    if len(fitted) < FEWEST_RUNS:
        plural = " is" if len(fitted) == 1 else "s are"
        raise RunError(
            f"{len(fitted)} run{plural} too few to tell a missing effect from chance; give at least {FEWEST_RUNS}"
        )
    each = each or (lambda function, work, stage: [function(item) for item in work])
    study = study_of(fitted, base, channels=chosen.names)
    found = search(study, seed, each)
    study = found.study
    signals, sensors = study.signals, study.channels
    held_out = Study(tuple(kept), base, study.driven, signals, channels=sensors) if kept else None
    held_out_gap = None if held_out is None else gap(held_out, found.base, found.final)
    ahead = outlook(study, found.base, found.final)
    held_out_ahead = None if held_out is None else outlook(held_out, found.base, found.final)
    word, why = judge.verdict_of(study, found, held_out_gap, held_out_ahead)
    listed = word in ("named", "suspected")
    named = judge.named_effects(study, found, split_by(study, found)) if listed else ()
    return Diagnosis(
        verdict=word,
        study=study,
        found=found,
        effects=named,
        gap=gap(study, found.base, found.final, fitted=True),
        held_out=held_out,
        held_out_gap=held_out_gap,
        detectable=judge.detectable(study, found),
        why=why,
        outlook=ahead,
        held_out_outlook=held_out_ahead,
        channels=chosen,
    )
