"""The errors of the walk through a hidden effect are those of its parameters, under the commands of every run."""

import re

import pytest
from repository import SAMPLE_RUNS
from test_readme import PAGES

from automarine_cli.comparison.validation import compare
from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels
from automarine_cli.runs.load import load_runs

PAGE = PAGES["automarine_cli/guide/hidden-walk.md"]


def columns(first: str) -> dict[str, list[float]]:
    """The numbers of each row of the table that begins so, without their intervals."""
    (table,) = re.findall(rf"^\| ?{re.escape(first)}.*\n(?:\|.*\n)+", PAGE, flags=re.MULTILINE)
    rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:])
    return {name: [float(x.split()[0]) if x != "–" else 0.0 for x in row] for name, *row in rows}


def test_the_errors_of_all_five_runs_follow_from_the_parameters() -> None:
    inertia, drag, chi, time = columns("parameter").values()
    models = {
        number: Model.base("3", inertia[i], (drag[i],), "nu", YAW).with_effect("water-swirl", (chi[i], time[i] or 1.0))
        for i, number in enumerate(("first", "swirl", "true"))
    }
    # the page leaves out the command delay of the first fit, 0.6 deg in a step
    *runs, over_all = columns("error [deg]").items()
    logs = [SAMPLE_RUNS / "hidden_one" / f"{name.strip('`')}.csv" for name, _ in runs]
    validation = compare(StoredModels(models, "true", 0.0, ""), load_runs(logs, dof=YAW).runs)
    for i, scored in enumerate(validation.models.values()):
        assert [of["rmse"] for of in scored.values] == pytest.approx(
            [errors[i] for _, errors in runs], rel=0.03, abs=0.1 if i else 0.6
        )
        assert scored.overall["rmse"].value == pytest.approx(over_all[1][i], rel=0.02)
