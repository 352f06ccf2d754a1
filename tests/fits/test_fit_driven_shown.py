"""What people see of a fit of driven runs: figure, rows of effects, the time constant of model 1."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_driven import Sea, steered

from automarine_cli.dofs import YAW
from automarine_cli.fits.identify import YawFit, identify_turns
from automarine_cli.report.fit_report import sentences, tables
from automarine_cli.report.sections import sections

pytestmark = pytest.mark.slow
LATE = "input-delay t_d"


@cache
def driven() -> YawFit:
    """Runs of a vehicle that answers 0.3 s late, fitted with that effect."""
    return identify_turns(
        YAW, (), (), lambda: steered(3, 1, Sea(delay=0.3), length=15.0), with_effects=("input-delay",)
    )


def test_the_figure_of_driven_runs_is_drawn() -> None:
    (draw,) = sections(driven()).figures.values()
    assert draw().axes


def test_effects_beside_drag_are_rows_with_intervals() -> None:
    table, _ = tables(driven())
    (row,) = (row for row in table.rows if str(row[0]).startswith(LATE))
    assert all("[" in str(cell) for cell in row[1:]) and "[s]" in str(row[0])
    found = {one["model"]: one["value"] for one in sections(driven()).rows if one["parameter"] == LATE}
    (effect,) = driven().to_json()["models"]["3"]["effects"]  # type: ignore[index]
    assert found["3"] == effect["parameters"]["t_d"]["value"] == pytest.approx(0.3, abs=0.2)


def test_model_1_tells_its_time_constant_and_never_the_angle_of_another() -> None:
    fit = driven()
    linear = replace(fit, preference=replace(fit.preference, number="1"))
    said = " ".join(sentences(linear))
    assert "Time constant I_r/k_r: " in said and "Inertial turn angle" not in said
    found = linear.time_constant
    assert found is not None and linear.to_json()["time_constant_s"] == found.to_json()
    values = linear.preferred.estimates
    assert found.value == pytest.approx(values["I_r"].value / values["k_r"].value)
    assert found.ci95[0] < found.value < found.ci95[1] and np.isfinite(found.stderr)
    assert linear.use is not None and linear.to_json()["proposed"] == dict(linear.use.proposed)
    quadratic = replace(fit, preference=replace(fit.preference, number="3"))
    assert "Inertial turn angle" in " ".join(sentences(quadratic)) and quadratic.time_constant is None
