"""Thruster maps: public bollard tables with levels left out, against a polynomial and a monotone spline."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from repository import DATA
from scipy.interpolate import PchipInterpolator

from automarine_cli.commands import automarine
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.map import ThrusterMap

Row = dict[str, Any]

TABLES = {
    "T200, 12 V": "t200_br2019_10-20V.csv", "T200, 16 V": "t200_br2019_10-20V.csv",
    "VideoRay M5, own propeller": "videoray_m5_vrprop.csv", "VideoRay M5, other propeller": "videoray_m5_nezprop.csv",
    "Kingfisher boat": "kingfisher_heron_bollard_mean.csv",
}  # fmt: skip
FOLDS, FEW = 5, 11
DENSE, SPARSE = "one level in five left out", f"{FEW} levels kept"
GIVEN = {
    "automarine": "`automarine fit-thrusters LOGS`, form by its own cross-validation.",
    "polynomial": "numpy `Polynomial.fit` over both directions, degree 1 to 9 by leave-one-out.",
    "monotone spline": "scipy `PchipInterpolator` through the levels that are left.",
}


def levels_of(table: str) -> tuple[Floats, Floats]:
    """Command in percent and force [N] of every measured level, ascending."""
    read = pd.read_csv(DATA / "thrusters" / TABLES[table])
    if "V" in table.split()[-1]:
        read = read[read["nominal_voltage_V"] == float(table.split()[-2])]
    if table.startswith("Kingfisher"):
        read = read[~read["cmd"].round(3).isin([-0.1, 0.0])]  # these were not measured
    mean = read.groupby("cmd")["force_n"].mean()
    return 100.0 * mean.index.to_numpy(), mean.to_numpy()


def kept(number: int, how: str, fold: int) -> NDArray[np.bool_]:
    """The levels that are fitted; the first and the last always."""
    at = np.arange(number)
    some = at % FOLDS != fold if how == DENSE else np.isin(at, np.linspace(0, number - 1, FEW).round())
    return some | (at == 0) | (at == number - 1)


def ours(n: Floats, force: Floats, new: Floats) -> Floats:
    with tempfile.TemporaryDirectory() as place:
        log, out = Path(place, "bollard.csv"), Path(place, "out")
        pd.DataFrame({"n": n.round(4), "force_N": force.round(5)}).to_csv(log, index=False)
        automarine(["fit-thrusters", str(log), "-o", str(out), "--figures", "none", "-qq"], standalone_mode=False)
        return np.asarray(ThrusterMap.load(out / "thrusters.json").force(new))


def polynomial(n: Floats, force: Floats, new: Floats) -> Floats:
    def missed(degree: int) -> float:
        basis = np.polynomial.chebyshev.chebvander(n / 100.0, degree)
        hat = basis @ np.linalg.pinv(basis)
        return float(np.mean(((force - hat @ force) / (1.0 - np.diag(hat))) ** 2))

    degree = min(range(1, min(10, len(n) - 1)), key=missed)
    return np.asarray(np.polynomial.Polynomial.fit(n, force, degree)(new))


def spline(n: Floats, force: Floats, new: Floats) -> Floats:
    return np.asarray(PchipInterpolator(n, force)(new))


TOOLS: dict[str, Callable[[Floats, Floats, Floats], Floats]] = {
    "automarine": ours, "polynomial": polynomial, "monotone spline": spline,
}  # fmt: skip


def cells() -> list[tuple[str, str, str]]:
    """Tool, table, which levels are left out; of tables at hand."""
    there = [table for table, name in TABLES.items() if (DATA / "thrusters" / name).exists()]
    return [(tool, table, how) for table in there for how in (DENSE, SPARSE) for tool in TOOLS]


def left_out(cell: tuple[str, str, str]) -> Row:
    """Error on levels left out [percent of the largest force]."""
    tool, table, how = cell
    n, force = levels_of(table)
    errors = []
    for fold in range(FOLDS if how == DENSE else 1):
        use = kept(len(n), how, fold)
        errors.append(TOOLS[tool](n[use], force[use], n[~use]) - force[~use])
    missed = np.concatenate(errors)
    return {"rms": 100.0 * float(np.sqrt(np.mean(missed**2)) / np.abs(force).max()), "levels": len(n)}


def summary(done: Mapping[str, Row]) -> list[Row]:
    """One row a table and way of leaving out, with the error of each tool."""
    rows: dict[str, Row] = {}
    for key, row in done.items():
        tool, table, how = key.split(" | ")
        row_of = rows.setdefault(f"{table} | {how}", {"table": table, "left out": how, "levels": row["levels"]})
        row_of[tool] = row["rms"]
    return list(rows.values())
