"""Half-turns at a few instants each, with which a fit is the fit to all of their samples.

The heading of a step is constant before its moment acts and analytic in time afterwards, whatever the parameters: one
value and a polynomial of some degree less than K give every sample, far more exactly than a compass shows them
(Trefethen 2013, Approximation Theory and Approximation Practice, chapter 8). Of such polynomials the sum of products
over a run's samples is a weighted sum over K nodes, exactly: Gauss's quadrature for these samples (Golub and Welsch
1969, Math. Comp. 23:221). The polynomials that are 0 at all nodes but one are therefore orthogonal over the samples;
with these, each divided by its norm, as columns of Q, y the samples of a run, f its headings at the nodes and w the
weights,

    |y - samples of the polynomial|² = |Q'y - sqrt(w) f|² + |y - Q Q'y|²

and the last term is the same for all parameters. Derivatives, sums of squares and numbers of samples are those of the
whole run, from a tenth of the headings or fewer.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.quantities import Floats

COUNTS = (16, 24, 36, 54)
"""Numbers of nodes that are tried in turn."""

PAYS = 2
"""Samples a node from which on nodes pay; shorter runs keep their samples."""

CLOSE_ENOUGH = 1e-5
"""Largest share [rad], rms over a run, of the two highest polynomials in headings: a thousandth of a degree's noise.
What no polynomial reaches is smaller still."""

AT_ONCE = 500
"""Runs whose polynomials are worked out together: of more they do not fit into the processor's caches."""


@dataclass(frozen=True)
class Nodes:
    """R runs at W instants: `time` (R, W) [s since the middle of the switch interval], `root` (R, W) the roots of the
    weights, `heading` (R, W) Q'y [rad], `seen` (R, W) what is no padding, `left` (R,) [rad²] the last term of the sum
    of squares, `highest` (R, 2, W) what makes the shares of the two highest polynomials of sqrt(w) f.
    """

    time: Floats
    root: Floats
    heading: Floats
    seen: NDArray[np.bool_]
    left: Floats
    highest: Floats

    def show(self, fitted: Floats, samples: NDArray[np.int64]) -> bool:
        """Whether headings sqrt(w) f (R, W) of a fit to runs of so many `samples` (R,) are between nodes what they are
        at them."""
        shares = np.abs(np.einsum("rkw,rw->rk", self.highest, fitted))
        return bool(np.all(shares.max(axis=1) <= CLOSE_ENOUGH * np.sqrt(samples)))


def nodes_of(time: Floats, heading: Floats, seen: NDArray[np.bool_], interval: Floats, count: int) -> Nodes | None:
    """Reduce runs (R, N) to `count` nodes each after the switch; times are since the middle of its `interval` (R,).

    None where that spares little.
    """
    edge = (0.5 - 1e-9) * interval[:, None]  # samples at the ends of the interval are outside: it is open
    rest, after = seen & (time <= -edge), seen & (time >= edge)
    long = after.sum(axis=1) >= PAYS * count
    alone = seen & ~rest & ~(after & long[:, None])  # samples that stand for themselves
    samples = int(alone.sum(axis=1).max(initial=0))
    own = alone.sum(axis=1) + rest.any(axis=1) + np.where(long, count, 0)
    if 2 * own.max() > time.shape[1]:
        return None
    shape = (len(time), samples + 1 + (count if long.any() else 0))
    (at, root, reduced), highest = np.zeros((3, *shape)), np.zeros((len(time), 2, shape[1]))
    kept, (own_time, own_heading) = _gathered(alone, time, heading)
    at[:, :samples], root[:, :samples], reduced[:, :samples] = own_time, kept, own_heading
    resting = rest.sum(axis=1)
    mean = np.where(rest, heading, 0.0).sum(axis=1) / np.maximum(resting, 1)
    at[:, samples], root[:, samples] = -interval, np.sqrt(resting)
    reduced[:, samples] = root[:, samples] * mean
    left = np.where(rest, (heading - mean[:, None]) ** 2, 0.0).sum(axis=1)
    every = np.flatnonzero(long)
    for runs in (every[i : i + AT_ONCE] for i in range(0, len(every), AT_ONCE)):
        part = (runs, slice(samples + 1, None))
        inside, (t, y) = _gathered(after[runs], time[runs], heading[runs])
        at[part], root[part], reduced[part], off, highest[runs, :, samples + 1 :] = _quadrature(t, y, inside, count)
        left[runs] += off
    seen, (at, root, reduced, *two) = _gathered(root > 0.0, at, root, reduced, highest[:, 0], highest[:, 1])
    return Nodes(at, root, reduced, seen, left, np.stack(two, axis=1))


def _gathered(mask: NDArray[np.bool_], *arrays: Floats) -> tuple[NDArray[np.bool_], tuple[Floats, ...]]:
    """What is marked of arrays (R, N), in front, and zero behind it; and where it stands, (R, most marked)."""
    count = mask.sum(axis=1)
    inside = np.arange(count.max(initial=0)) < count[:, None]
    found = tuple(np.zeros(inside.shape) for _ in arrays)
    for here, array in zip(found, arrays):
        here[inside] = array[mask]
    return inside, found


def _quadrature(
    time: Floats, heading: Floats, inside: NDArray[np.bool_], count: int
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Of runs (R, N): nodes (R, K), roots of their weights, Q'y, what is left of the sums of squares (R,), and what
    makes the shares of the two highest polynomials (R, 2, K)."""
    first, last = time[:, :1], time.max(axis=1, initial=-np.inf, where=inside, keepdims=True)
    x = 2.0 * (time - first) / (last - first) - 1.0
    basis, _ = np.linalg.qr(_chebyshev(x, count) * inside[..., None])  # orthogonal polynomials, lowest first
    points, turn = np.linalg.eigh(np.swapaxes(basis, 1, 2) @ (x[..., None] * basis))
    root = (basis.sum(axis=1)[:, None] @ turn)[:, 0]
    turn, root = turn * np.sign(root)[:, None], np.abs(root)
    image = (heading[:, None] @ basis)[:, 0]
    off = heading - (basis @ image[..., None])[..., 0]
    at = first + 0.5 * (points + 1.0) * (last - first)
    return at, root, (image[:, None] @ turn)[:, 0], (off**2).sum(axis=1), turn[:, -2:]


def _chebyshev(x: Floats, count: int) -> Floats:
    """Chebyshev polynomials of degree 0 to count - 1 at x (...), shape (..., count)."""
    out = np.ones((count, *x.shape))
    out[1] = x
    for k in range(2, count):
        np.multiply(2.0 * x, out[k - 1], out=out[k])
        out[k] -= out[k - 2]
    return np.moveaxis(out, 0, -1)
