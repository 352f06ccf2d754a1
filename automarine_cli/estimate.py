"""A number with its uncertainty: what every fit returns and every result file holds."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from automarine_cli.errors import ModelError

WIDE = 2.0  # half width of an interval on the logarithm from which on it is given on the number itself
UNDETERMINED = "the runs do not determine it"


@dataclass(frozen=True)
class Estimate:
    """Value, standard error, 95 % interval and unit of one parameter; whether it was `known` beforehand, or stands
    `at_bound` of its range."""

    value: float
    stderr: float
    ci95: tuple[float, float]
    unit: str
    known: bool = False
    at_bound: bool = False

    @classmethod
    def from_stderr(cls, value: float, stderr: float, dof: float, unit: str) -> "Estimate":
        """Interval from Student's t with `dof` degrees of freedom (about the independent runs less parameters)."""
        half = float(special.stdtrit(max(dof, 1.0), 0.975)) * stderr
        return cls(float(value), float(stderr), (float(value - half), float(value + half)), unit)

    @classmethod
    def from_log(cls, value: float, stderr_of_log: float, dof: float, unit: str) -> "Estimate":
        """Interval of a positive number, symmetric on its logarithm while that is narrow. Beyond `WIDE` the data hardly
        tell the number from zero; then it is symmetric on the number itself and begins at zero (on the logarithm it
        would end at infinity)."""
        half = float(special.stdtrit(max(dof, 1.0), 0.975)) * stderr_of_log
        low, high = (0.0, 1.0 + half) if half > WIDE else (np.exp(-half), np.exp(half))
        return cls(float(value), float(value * stderr_of_log), (float(value * low), float(value * high)), unit)

    def scaled(self, factor: float, unit: str) -> "Estimate":
        """Return it times a factor, in `unit`."""
        value, stderr, *ends = (factor * size for size in (self.value, self.stderr, *self.ci95))
        return replace(self, value=value, stderr=abs(stderr), ci95=(min(ends), max(ends)), unit=unit)

    def to_json(self) -> dict[str, object]:
        """The contract's form; what is not finite is missing, and `at_bound` says why."""
        if not np.all(np.isfinite([self.value, self.stderr, *self.ci95])):
            value = self.value if np.isfinite(self.value) else None
            return {"value": value, "stderr": None, "ci95": None, "unit": self.unit, "at_bound": UNDETERMINED}
        plain = {"value": self.value, "stderr": self.stderr, "ci95": list(self.ci95), "unit": self.unit}
        return plain | {name: True for name in ("known", "at_bound") if getattr(self, name)}


@dataclass(frozen=True)
class Given:
    """A number as a result file holds it: an estimate, a value without an interval (`at_bound` says why), or a plain
    number; the value is None for what lies beyond all that was measured. `known_`: it was known before the fit."""

    value: float | None
    stderr: float | None = None
    ci95: tuple[float, float] | None = None
    unit: str = ""
    at_bound: str | bool = ""
    known_: bool = False

    @classmethod
    def of_number(cls, value: float) -> "Given":
        """A plain number."""
        return cls(value)

    def to_json(self) -> object:
        """The contract's form without an interval; a plain number where nothing says why it has none."""
        nothing = {"value": self.value, "stderr": None, "ci95": None, "unit": self.unit, "at_bound": self.at_bound}
        return nothing if self.at_bound else self.value

    @property
    def estimate(self) -> Estimate | None:
        """The estimate; None where the interval is not known."""
        if self.value is None or self.stderr is None or self.ci95 is None:
            return None
        return Estimate(self.value, self.stderr, self.ci95, self.unit, self.known_, bool(self.at_bound))

    def known(self, place: str) -> Estimate:
        """The estimate. Raises ModelError with the `place` in the file where the interval is not known."""
        if (estimate := self.estimate) is None:
            raise ModelError(f"{place}: found a number without stderr and ci95, expected an estimate")
        return estimate
