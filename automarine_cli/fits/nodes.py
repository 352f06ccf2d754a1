"""Half-turns at a few instants each, with which a fit is the fit to all of their samples.

The heading of a step is constant before its moment acts and analytic in time afterwards, whatever the parameters: one
value and those at some Chebyshev nodes give every sample, far more exactly than a compass shows them (Trefethen 2013,
Approximation Theory and Approximation Practice, chapter 8). With y the samples of a run, f the headings at its nodes,
E the interpolation from nodes to samples and E = Q C with orthogonal Q,

    |y - E f|² = |Q'y - C f|² + |y - Q Q'y|²

and the last term is the same for all parameters. Derivatives, sums of squares and numbers of samples are those of the
whole run, from a tenth of the headings or fewer.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from automarine_cli.quantities import Floats

COUNTS = (16, 24, 36, 54)
"""Numbers of nodes that are tried in turn."""

PAYS = 4
"""Samples a node from which on nodes pay, and polynomials through samples are well posed; shorter runs keep their
samples."""

CLOSE_ENOUGH = 1e-5
"""Largest share [rad], rms over a run, of the two highest polynomials in headings: a thousandth of a degree's noise.
What no polynomial reaches is smaller still."""


@dataclass(frozen=True)
class Nodes:
    """R runs at W instants: `time` (R, W) [s since the middle of the switch interval], `carry` (R, W, W) the matrices
    C, `heading` (R, W) Q'y [rad], `seen` (R, W) what is no padding, `left` (R,) [rad²] the last term of the sum of
    squares. `highest` (R, W) marks what belongs to the two highest polynomials.
    """

    time: Floats
    carry: Floats
    heading: Floats
    seen: NDArray[np.bool_]
    left: Floats
    highest: NDArray[np.bool_]

    def show(self, fitted: Floats, samples: NDArray[np.int64]) -> bool:
        """Whether headings C f (R, W) of a fit to runs of so many `samples` (R,) are between nodes what they are at
        them."""
        return bool(np.all(np.where(self.highest, fitted**2, 0.0).max(axis=1) <= CLOSE_ENOUGH**2 * samples))


def nodes_of(time: Floats, heading: Floats, seen: NDArray[np.bool_], interval: Floats, count: int) -> Nodes | None:
    """Reduce runs (R, N) to `count` nodes each after the switch; times are since the middle of its `interval` (R,).

    None where that spares little.
    """
    parts = [_run_nodes(t[s], y[s], width, count) for t, y, s, width in zip(time, heading, seen, interval)]
    widest = max(len(part[0]) for part in parts)
    if 2 * widest > time.shape[1]:
        return None
    shape = (len(parts), widest)
    nodes = Nodes(
        time=np.zeros(shape),
        carry=np.zeros((*shape, widest)),
        heading=np.zeros(shape),
        seen=np.zeros(shape, dtype=bool),
        left=np.array([part[3] for part in parts]),
        highest=np.zeros(shape, dtype=bool),
    )
    for i, (at, carry, reduced, _, long) in enumerate(parts):
        w = len(at)
        nodes.time[i, :w], nodes.carry[i, :w, :w], nodes.heading[i, :w], nodes.seen[i, :w] = (at, carry, reduced, True)
        nodes.highest[i, w - 2 : w] = long
    return nodes


def _run_nodes(
    time: Floats, heading: Floats, interval: float, count: int
) -> tuple[Floats, Floats, Floats, float, bool]:
    """Node times (W,), C (W, W), Q'y (W,) and the rest of the sum of squares of one run, and whether it is long enough
    for polynomials, which then come last."""
    edge = (0.5 - 1e-9) * interval  # samples at the ends of the interval are outside: it is open
    rest, after = time <= -edge, time >= edge
    long = np.count_nonzero(after) >= PAYS * count
    alone = ~(rest | after) if long else ~rest  # samples that stand for themselves
    at, reduced, left = [time[alone]], [heading[alone]], 0.0
    blocks = [np.eye(len(at[0]))]
    if rest.any():
        root = np.sqrt(np.count_nonzero(rest))
        mean = heading[rest].mean()
        at.append(np.array([-interval]))
        blocks.append(np.array([[root]]))
        reduced.append(np.array([root * mean]))
        left += float(((heading[rest] - mean) ** 2).sum())
    if long:
        first, last = time[after][0], time[after][-1]
        basis = _chebyshev(2.0 * (time[after] - first) / (last - first) - 1.0, count)
        q, upper = np.linalg.qr(basis)
        image = heading[after] @ q
        off = heading[after] - q @ image
        points, to_coefficients = _nodes(count)
        at.append(first + 0.5 * (points + 1.0) * (last - first))
        blocks.append(upper @ to_coefficients)
        reduced.append(image)
        left += float(off @ off)
    width = sum(len(block) for block in blocks)
    carry, start = np.zeros((width, width)), 0
    for block in blocks:
        stop = start + len(block)
        carry[start:stop, start:stop] = block
        start = stop
    return np.concatenate(at), carry, np.concatenate(reduced), left, bool(long)


@cache
def _nodes(count: int) -> tuple[Floats, Floats]:
    """Chebyshev points of the first kind (K,) in (-1, 1), and the matrix (K, K) from values there to coefficients."""
    points = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    to_coefficients = _chebyshev(points, count).T * (2.0 / count)
    to_coefficients[0] /= 2.0
    return points, to_coefficients


def _chebyshev(x: Floats, count: int) -> Floats:
    """Chebyshev polynomials of degree 0 to count - 1 at x (N,), shape (N, count)."""
    out = np.ones((count, len(x)))
    out[1] = x
    for k in range(2, count):
        np.multiply(2.0 * x, out[k - 1], out=out[k])
        out[k] -= out[k - 2]
    return out.T
