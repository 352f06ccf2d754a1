"""What a model file says of how far its numbers may be trusted: their covariance, and the range that was fitted."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from automarine_cli.models.yaw_model import YawModel, steady_rate
from automarine_cli.quantities import Floats


def covariance_json(
    names: Sequence[str], theta: Floats, positive: NDArray[np.bool_], covariance: Floats
) -> dict[str, object] | None:
    """Covariance of the first parameters of theta (p,), named, from that of phi (p, p), in which positive ones are
    logarithms; in the products of the parameters' units. None where it is not finite."""
    count = len(names)
    scale = np.where(positive, theta, 1.0)[:count]
    matrix = covariance[:count, :count] * np.outer(scale, scale)
    return {"parameters": list(names), "matrix": matrix.tolist()} if np.all(np.isfinite(matrix)) else None


def valid_range(moments: Iterable[float], model: YawModel) -> dict[str, object] | None:
    """The moments that were fitted, smallest and largest with their signs, and the steady rates that they lead to.

    None without moments; the rates are None where the drag leaves no steady rate.
    """
    given = [float(moment) for moment in moments]
    if not given:
        return None
    ends = np.array([min(given), max(given)])
    rates = steady_rate(*model.acting(ends))
    return {
        model.dof.words.force: ends.tolist(),
        model.dof.velocity_key: rates.tolist() if np.all(np.isfinite(rates)) else None,
    }
