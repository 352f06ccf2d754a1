"""The nomenclature: names, symbols, units and signs used everywhere (SNAME 1950; Fossen 2011).

Inside automarine angles are radians, times seconds, forces newtons; degrees appear only at the edges
(columns and keys whose name ends in `_deg`, and every figure). Yaw is positive clockwise seen from above.
The yaw moment carries the unit of the logs: "nu", the normalised moment unit of the source paper, or "N m".
"""

from dataclasses import dataclass

MOMENT_UNITS = ("nu", "N m")

CLOCK, SINCE = "campaign-clock", "time-since-command-change"
"""Signals that every log has beside its columns: its clock, and the time since its command last changed, both [s]."""


@dataclass(frozen=True)
class Quantity:
    """One physical quantity: symbol for plots (mathtext), unit in print."""

    name: str
    symbol: str
    unit: str

    @property
    def label(self) -> str:
        """Axis label: name, symbol and unit in brackets."""
        return f"{self.name} {self.symbol} [{self.unit}]"


def unit_of(parameter: str, moment_unit: str = "nu") -> str:
    """Unit of a yaw parameter (`k_r`, `k_rr`, `k_rrr`, `I_r`, `tau`, `theta_c`) for a moment unit."""
    suffix = {"k_r": " s", "k_rr": " s²", "k_rrr": " s³", "I_r": " s²", "tau": "", "theta_c": None}[parameter]
    return "rad" if suffix is None else moment_unit + suffix


SYMBOLS = {
    "k_r": r"$k_r$",
    "k_rr": r"$k_{r|r|}$",
    "I_r": r"$I_r$",
    "tau": r"$\tau$",
    "psi": r"$\psi$",
    "r": r"$r$",
    "theta_c": r"$I_r/k_{r|r|}$",
}
