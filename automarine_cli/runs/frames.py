"""Do logged speeds and places go with the heading? In other axes they are those of a vehicle that does not exist.

Velocities are complex: ahead + i abeam, north + i east. Turned by the heading, a hull's is that over ground.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.quantities import Complexes
from automarine_cli.runs.run import Run, filled

PIECE_S = 2.0  # over which velocities are means: longer than noise, shorter than manoeuvres
CLEARER = 0.5  # share of what the columns' own axes leave unexplained that other axes may leave to be the right ones
MAX_UNEXPLAINED_SHARE = 0.2  # share of squared speeds that the right axes leave at most
TURNED = np.deg2rad(30.0)  # more than a compass errs
FIXED = "Surge and sway speed change with the heading as along fixed axes. Turn them into the vehicle's axes."
MIRRORED = (
    "Positions turn against the heading. Look whether north and east are exchanged, or the heading counts "
    "counterclockwise."
)
Pair = tuple[Complexes, Complexes]
"""Velocities as measured and as expected, (P,), of the pieces of a run."""


def frame_warnings(runs: Iterable[Run]) -> tuple[str, ...]:
    """Say how speeds or places of a campaign go along other axes than their columns say.

    Speeds that are not logged are taken to go as the forces do."""
    pairs = defaultdict[str, list[Pair]](list)
    for run in runs:
        if run.dof is not YAW or run.summed_up:
            continue
        heading, rest = np.exp(1j * run.position), 0.0 * run.time
        speeds, places = _logged(run, (SURGE.velocity, SWAY.velocity)), _logged(run, ("north", "east"))
        if speeds is not None:
            pairs["hull"].append(_means(run, speeds, np.ones(len(run), dtype=complex)))
            pairs["fixed"].append(_means(run, speeds, heading))
        forces = run.extras.get(SURGE.command, rest) + 1j * run.extras.get(SWAY.command, rest)
        speed = forces if speeds is None else speeds
        if places is not None:
            way = np.gradient(places, run.time)
            pairs["ground"].append(_means(run, way, speed * heading))
            pairs["exchanged"].append(_means(run, way, np.conj(speed * heading)))
            pairs["reversed"].append(_means(run, way, speed * np.conj(heading)))
    unexplained = {axes: _unexplained(of_axes) for axes, of_axes in pairs.items()}
    for instead, axes, warning in (
        ("fixed", "hull", FIXED), ("exchanged", "ground", MIRRORED), ("reversed", "ground", MIRRORED),
    ):  # fmt: skip
        if instead in unexplained and unexplained[instead] < min(CLEARER * unexplained[axes], MAX_UNEXPLAINED_SHARE):
            return (warning,)
    turns = [float(np.angle(np.vdot(expected, measured))) for measured, expected in pairs["ground"]]
    turn = abs(max(turns, key=abs, default=0.0))
    if turn > TURNED and unexplained["ground"] < MAX_UNEXPLAINED_SHARE:
        return (f"Positions are turned by up to {np.rad2deg(turn):.0f} deg against the heading.",)
    return ()


def _logged(run: Run, names: tuple[str, str]) -> Complexes | None:
    """Two columns as a complex one without gaps, (N,); None where either was not logged."""
    first, second = map(run.channel, names)
    return None if first is None or second is None else filled(run.time, first) + 1j * filled(run.time, second)


def _means(run: Run, measured: Complexes, expected: Complexes) -> Pair:
    """Means over pieces of a run."""
    piece = ((run.time - run.time[0]) / PIECE_S).astype(int)
    count = np.maximum(np.bincount(piece), 1)

    def mean(values: Complexes) -> Complexes:
        return np.asarray((np.bincount(piece, values.real) + 1j * np.bincount(piece, values.imag)) / count)

    return mean(measured), mean(expected)


def _unexplained(pairs: Sequence[Pair]) -> float:
    """Share of squared velocities that those expected leave, each run's turned and scaled as suits it best."""
    squares, explained = 0.0, 0.0
    for v, w in pairs:
        squares += float(np.vdot(v, v).real)
        explained += abs(complex(np.vdot(w, v))) ** 2 / max(float(np.vdot(w, w).real), 1e-30)
    return 1.0 - explained / squares if squares > 0 else 1.0
