"""Runs that are looked at together give what each gives alone, to the last digit."""

from dataclasses import fields, replace

import numpy as np
import pytest
from made_runs import mirrored, step_run

from automarine_cli.dofs import YAW
from automarine_cli.logs import LogTable
from automarine_cli.runs import flat
from automarine_cli.runs.clean import Split, plain_rows
from automarine_cli.runs.half_turn import HalfTurn
from automarine_cli.runs.noise import position_noise, position_noises
from automarine_cli.runs.run import Run
from automarine_cli.runs.turns import half_turns


def campaign(side: str) -> list[Run]:
    """Runs with and without rest, of several steps, too short, stuck, against their command, idle."""
    runs = [step_run(moment, seed=i, length=4.0 + i) for i, moment in enumerate([-1.2, -0.5, 0.1, 0.5, 1.2])]
    runs += [
        step_run(0.7, rest=0.0, seed=5),
        step_run(0.7, rest=0.0, rate0=0.4, seed=6),
        step_run(0.9, rest=0.5, seed=7),
    ]
    runs += [step_run(0.8, length=1.0, seed=8), step_run(0.8, noise_deg=0.0), step_run(-0.8, noise_deg=3.0, seed=9)]
    one = step_run(0.6, length=14.0, seed=10)
    half = one.time < one.time.mean()
    runs.append(replace(one, moment=np.where(half, one.command, 0.3)))
    runs.append(replace(one, moment=np.where(half, one.command, 0.0)))
    runs.append(replace(one, moment=0.0 * one.command))
    runs.append(replace(one, moment=-one.command))
    runs.append(replace(one, position=np.where(half, one.position, one.position[half][-1])))
    runs.append(replace(one, position=np.full(len(one), 1.0)))
    runs = [replace(run, name=f"r{i}") for i, run in enumerate(runs)]
    return [mirrored(run) for run in runs] if side == "mirrored" else runs


def told(turn: HalfTurn) -> list[object]:
    """A half-turn, to be compared."""
    shown: list[object] = [turn.time.tobytes(), turn.position.tobytes()]
    shown += [getattr(turn, one.name) for one in fields(turn) if one.name not in ("step", "time", "position")]
    return shown + [getattr(turn.step, one.name) for one in fields(turn.step) if one.name != "run"]


@pytest.mark.parametrize("side", ["as it is", "mirrored"])
@pytest.mark.parametrize("together", [1, 400, 1 << 18])
def test_half_turns_of_many_runs_are_those_of_each(side: str, together: int, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = campaign(side)
    alone = [half_turns([run]) for run in runs]
    monkeypatch.setattr(flat, "TOGETHER", together)
    turns, aside = half_turns(runs)
    assert [told(turn) for turn in turns] == [told(turn) for some, _ in alone for turn in some]
    assert aside == tuple(one for _, some in alone for one in some)
    assert len(turns) >= 6 and len({one.why.partition(":")[0] for one in aside}) >= 4


def test_noises_of_many_runs_are_those_of_each() -> None:
    runs = [run.cut(0, stop) for run in campaign("as it is") for stop in (3, 6, 7, 8, 30, len(run))]
    edges = flat.edges_of([len(run) for run in runs])
    time, position = (np.concatenate([getattr(run, name) for run in runs]) for name in ("time", "position"))
    found = position_noises(time, position, edges)
    assert found.tolist() == [position_noise(run.time, run.position) for run in runs]
    assert found[[len(run) < 7 for run in runs]].max() == 0 < found.max()


@pytest.mark.parametrize("side", ["as it is", "mirrored"])
def test_plain_rows_of_many_tables_are_those_of_each(side: str) -> None:
    """Also where the rows of a table's runs take turns, and where a run is spoilt."""
    splits = []
    for i, run in enumerate(campaign(side)):
        heading = np.mod(run.position, 2 * np.pi)
        heading[5] = [heading[5], np.nan, heading[5] + 1.0][i % 3]
        table = LogTable(
            f"{i}.csv", {"time": run.time, "heading": heading, "moment": run.command}, np.arange(len(run)), dof=YAW
        )
        middle, order = len(run) // 2, np.argsort(np.arange(len(run)) % 2, kind="stable")
        edges = [[0, len(run)], [0, middle, len(run)], [0, len(run) - middle, len(run)]][i % 3]
        splits.append(Split(table, ["a", "b"][: len(edges) - 1], order if i % 3 == 2 else None, np.array(edges)))
    alone = [found for split in splits for found in plain_rows([split])]
    together = plain_rows(splits)
    assert [[None if one is None else one.tobytes() for one in some] for some in together] == [
        [None if one is None else one.tobytes() for one in some] for some in alone
    ]
    every = [one for some in together for one in some]
    assert any(one is None for one in every) and any(one is not None for one in every)
