"""How much each effect could explain of a thruster map's residuals, and how much chance would let it explain.

The score of an effect is the fall of the squared residuals along the direction in which its curve leaves the base
curve, freed of everything that the base's own parameters can do; the largest over a grid of sizes. Chance is the same
number on residuals whose signs are thrown group by group (Wu 1986, Ann. Stat. 14:1261: the wild bootstrap): a level,
or in a dense table a block of neighbours, is the unit, and noise that grows with thrust stays where it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.fits.stepwise import Chance
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.bollard_data import BollardData
from automarine_cli.thrusters.curves import jacobian
from automarine_cli.thrusters.forms import Curve
from automarine_cli.thrusters.points import Ints
from automarine_cli.thrusters.shapes import ASYMMETRY, SAG, VOLTAGE, Fitted, form_of, multiplier_columns

NULLS = 1999
CHANCE = 0.01
"""Share of tables without a missing effect in which one is claimed; fewer cannot be told with eight levels."""
DEAD = np.concatenate([np.arange(0.005, 0.05, 0.005), np.arange(0.05, 0.42, 0.025)])
"""Dead bands tried [share of the largest command]."""
POWERS = (-0.8, -0.6, -0.4, -0.2, -0.1, -0.05, -0.02, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8)
"""Changes of the exponent tried."""
TOPS = np.concatenate([np.arange(0.35, 0.9, 0.05), np.arange(0.9, 1.0, 0.02)])
"""Saturations tried [share of the largest command]."""
POWER_80 = 0.84
SMALLEST = 1e-12


@dataclass(frozen=True)
class Scores(Chance):
    """Evidence of each candidate, in the order asked for, beside what chance reaches with the best of them all.

    Evidence is G log(SSE before / SSE after) less log(G) for each parameter, G the number of groups.
    `smallest` is, by effect, the smallest size that these levels would show four times in five (None: none tried
    would).
    """

    evidence: Floats
    smallest: dict[str, float | None]

    @property
    def least_evidence(self) -> float:
        """Evidence that chance reaches in a share CHANCE of tables; no less than nothing."""
        return max(self.threshold(CHANCE), 0.0)


@dataclass(frozen=True)
class _Direction:
    """Unit rows by which an effect can leave the base, shape (K, P); `sizes` (K,) and `lengths` (K,) [N]."""

    rows: Floats
    one_sided: bool
    sizes: Floats
    lengths: Floats

    def fall(self, errors: Floats) -> Floats:
        """Largest fall of the squared errors, shape (M,), for errors of shape (M, P)."""
        along = errors @ self.rows.T
        along = np.maximum(along, 0.0) if self.one_sided else along
        return np.asarray(np.max(along**2, axis=1, initial=0.0))


def score(found: Fitted, candidates: Sequence[tuple[str, str]], random: np.random.Generator) -> Scores:
    """Score every candidate (effect, where) against the fitted model `found`."""
    data = found.data
    root = np.sqrt(data.points.weight)
    basis = _basis(root[:, None] * _base_columns(found))
    errors = _freed((root * found.residual)[None, :], basis)
    # Residuals shrink where the fit leans on a level; chance gets them back at their full size (HC3).
    leverage = np.minimum(np.sum(basis**2, axis=1), 0.99)
    nulls = _freed(_thrown(data, errors[0] / (1.0 - leverage), random), basis)
    pieces = {key: _direction(found, *key, root, basis) for key in _single(candidates, found)}
    both = np.vstack([errors, nulls])
    falls = {key: piece.fall(both) for key, piece in pieces.items()}
    squares = np.sum(both**2, axis=1) + (SMALLEST * data.full_scale) ** 2
    levels = len(np.unique(data.group))
    table = []
    for effect, where in candidates:
        keys = [key for key in pieces if key[0] == effect and where in ("both", key[1])]
        fall = np.minimum(sum(falls[key] for key in keys), (1.0 - 1e-9) * squares)
        table.append(-levels * np.log1p(-fall / squares) - len(keys) * np.log(levels))
    evidence = np.stack(table) if table else np.zeros((0, len(both)))
    null = np.max(evidence[:, 1:], axis=0) if table else np.zeros(NULLS)
    scores = Scores(null, evidence[:, 0], {})
    sigma = float(np.sqrt(squares[0] / max(len(root) - basis.shape[1], 1)))
    least = scores.least_evidence + np.log(levels)
    needed = float(np.sqrt(squares[0] * -np.expm1(-least / levels))) + POWER_80 * sigma
    return replace(scores, smallest=_smallest(pieces, needed))


def _single(candidates: Sequence[tuple[str, str]], found: Fitted) -> list[tuple[str, str]]:
    """Candidates taken apart into one direction each."""
    sides = [name for name, _ in found.shape.curves]
    keys = []
    for effect, where in candidates:
        apart = [where] if effect in (ASYMMETRY, VOLTAGE, SAG) or where in sides else sides
        keys += [(effect, name) for name in apart if (effect, name) not in keys]
    return keys


def _smallest(pieces: dict[tuple[str, str], _Direction], needed: float) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for (effect, _), piece in pieces.items():
        sizes = piece.sizes[piece.lengths >= needed]
        size = float(np.min(sizes)) if len(sizes) else None
        old = found.get(effect)
        found[effect] = size if effect not in found else None if None in (old, size) else max(old or 0, size or 0)
    return found


def _thrown(data: BollardData, errors: Floats, random: np.random.Generator) -> Floats:
    """Null errors, shape (NULLS, P): every group's with a sign of its own."""
    _, place = np.unique(data.group, return_inverse=True)
    signs = random.choice([-1.0, 1.0], size=(NULLS, int(place.max()) + 1))
    return np.asarray(signs[:, place.ravel()] * errors[None, :])


def _basis(columns: Floats) -> Floats:
    """Orthonormal columns, shape (P, rank)."""
    size = np.sqrt(np.sum(columns**2, axis=0))
    left, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(left[:, values > 1e-9])


def _freed(rows: Floats, basis: Floats) -> Floats:
    return np.asarray(rows - (rows @ basis) @ basis.T)


def _values(curve: Curve, scale: float) -> Floats:
    """The curve as `thrusters.curves` writes it: amplitude at full command, dead band, exponent, saturation."""
    dead = curve.n_0 / scale
    top = 1.0 if curve.n_sat is None else min(curve.n_sat / scale, 1.0)
    return np.array([[curve.a * (scale - curve.n_0) ** curve.p, dead, curve.p, top]])


def _base_columns(found: Fitted) -> Floats:
    """Derivatives of the thrust [N] by every free parameter, shape (P, K)."""
    data, columns = found.data, [multiplier_columns(found, found.shape)]
    gain = found.gain(data)
    for name, (index, side) in data.parts(found.shape.tied).items():
        form = form_of(dict(found.shape.curves)[name])
        scale = float(side.magnitude.max())
        free = np.array([True, form.dead_band, form.exponent, form.saturation])
        own = jacobian(side.magnitude / scale, _values(found.curves[name], scale))[0][:, free]
        whole = np.zeros((len(gain), own.shape[1]))
        whole[index] = (np.sign(data.points.n[index]) * gain[index])[:, None] * own
        columns.append(whole)
    return np.hstack(columns)


def _direction(found: Fitted, effect: str, where: str, root: Floats, basis: Floats) -> _Direction:
    if effect in (ASYMMETRY, VOLTAGE, SAG):
        rows, sizes = _multiplied(found, effect), np.array([0.01])
        rows = np.repeat(rows * sizes[0], 40, axis=0) * np.arange(1, 41)[:, None]
        sizes = sizes[0] * np.arange(1, 41)
    else:
        index, side = found.data.parts(found.shape.tied)[where]
        rows, sizes = _bent(found, effect, where, index, side.magnitude)
    freed = _freed(rows * root[None, :], basis)
    lengths = np.sqrt(np.sum(freed**2, axis=1))
    seen = lengths > 1e-9 * np.sqrt(np.sum((rows * root[None, :]) ** 2, axis=1)) + 1e-300
    one_sided = effect in ("dead-band", "saturation")
    return _Direction(freed[seen] / lengths[seen, None], one_sided, sizes[seen], lengths[seen])


def _multiplied(found: Fitted, effect: str) -> Floats:
    """The one direction of an effect that multiplies the thrust, shape (1, P), for a size of one."""
    data = found.data
    if effect == ASYMMETRY:
        return (found.predicted * np.sign(data.points.n) * 0.5)[None, :]
    if effect == VOLTAGE:
        volts = data.points.voltage
        return (found.predicted * np.log(volts / np.median(volts)))[None, :]
    return -(found.predicted * data.order)[None, :]


def _bent(found: Fitted, effect: str, where: str, index: Ints, size: Floats) -> tuple[Floats, Floats]:
    """Directions of an effect of the curve, shape (K, P), and its sizes (K,)."""
    curve, scale = found.curves[where], float(size.max())
    if effect == "dead-band":
        lowest = float(np.sort(np.unique(size))[-2]) / scale
        sizes = DEAD[0.9 * lowest > DEAD]
        bent = [replace(curve, n_0=share * scale) for share in sizes]
        shown = sizes * scale
    elif effect == "thrust-exponent":
        sizes = np.array([p for p in POWERS if curve.p + p > 0.25])
        bent = [replace(curve, p=curve.p + p) for p in sizes]
        shown = np.abs(sizes)
    else:
        sizes = TOPS[TOPS * scale > curve.n_0 * 1.05]
        bent = [replace(curve, n_sat=share * scale) for share in sizes]
        shown = 1.0 - sizes
    sign = np.sign(found.data.points.n[index]) * found.gain(found.data)[index]
    rows = np.zeros((len(sizes), len(found.data.points)))
    for row, one in enumerate(bent):
        # The same thrust at full command, so that the direction is a change of shape and not of units.
        top = float(curve.thrust(np.array([scale]))[0] / max(one.thrust(np.array([scale]))[0], 1e-300))
        rows[row, index] = sign * (top * one.thrust(size) - curve.thrust(size))
    return rows, shown
