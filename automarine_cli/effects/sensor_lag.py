"""A heading that is read late: a floating compass card, a filter in the attitude reference."""

from collections.abc import Sequence

import numpy as np

from automarine_cli.effects.base import Effect, Floats, Parameter, Place


class SensorLag(Effect):
    name = "sensor-lag"
    place = Place.SENSOR
    parameters = (Parameter("T_s", "time constant of the {position} sensor", "s", 0.0, 3.0, 0.1),)
    equation = "T_s {x}_m' = {x} - {x}_m"
    says = "The {position} is read with a lag."
    reveals = "reversals, and {moving} the vehicle by hand next to a second sensor"
    mistaken_for = ("input-delay", "thruster-lag")
    separated_by = "{moving} the vehicle by hand, or a second {position} sensor"
    source = "Titterton and Weston (2004), Strapdown Inertial Navigation Technology"
    remembers = True

    def late(self, values: Sequence[float]) -> float:
        return float(values[0])

    def read(self, heading: Floats, time: Floats, values: tuple[Floats, ...]) -> Floats:
        """Starts without lag at the run's first sample."""
        (lag,) = values
        shape = np.broadcast_shapes(heading.shape, time.shape, lag.shape)
        lag = np.broadcast_to(lag, shape)[..., 0]
        step = np.maximum(np.diff(np.broadcast_to(time, shape), axis=2), 0.0)
        heading = np.broadcast_to(heading, shape)
        out = np.empty(shape)
        out[..., 0] = heading[..., 0]
        for m in range(shape[2] - 1):
            out[..., m + 1] = self.remember(out[..., m], heading[..., m], heading[..., m + 1], step[..., m], (lag,))
        return out

    def remember(
        self, reading: Floats, before: Floats, after: Floats, length: Floats, values: tuple[Floats, ...]
    ) -> Floats:
        """Exact for a heading that is straight between two nodes."""
        lag = np.maximum(values[0], 1e-6)
        rise = (after - before) / np.maximum(length, 1e-12)
        return after + (reading - before) * np.exp(-length / lag) + lag * rise * np.expm1(-length / lag)
