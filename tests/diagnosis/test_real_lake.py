"""Ten closed-loop runs of a Kingfisher boat on a lake: whole runs, moving starts, a delay, headings the other way."""

from pathlib import Path

import numpy as np
import pytest
from few_candidates import few_candidates
from repository import DATA

from automarine_cli import effects
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.dofs import YAW
from automarine_cli.filters.course import make_course
from automarine_cli.fits.driven import beside_forecasts, fit_driven, judged_of
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.whole_runs import rough_model
from automarine_cli.logs import read_column_map
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.thrusters.map import drive_run_by_thrusters

LAKE, BOLLARD = DATA / "yaw" / "kingfisher_lake", DATA / "thrusters" / "kingfisher_heron_bollard_raw.csv"
pytestmark = pytest.mark.real_data(LAKE)

NOMINAL = """
[columns]
heading_deg = { from = "heading_deg", unit = "deg", sign = -1 }
tau_Nm = { from = "tau_N_nominal_Nm", unit = "N m", sign = -1 }
"""
COMMANDS = """
[columns]
heading_deg = { from = "heading_deg", unit = "deg", sign = -1 }
n_port = "port_cmd"
n_stbd = "stbd_cmd"
"""
WITH_SURGE = f'{NOMINAL}surge_m_s = "speed_mps"\n'
FITTED, LEFT_OUT = ("01", "05", "15", "21", "25"), ("03", "11", "19", "23", "29")
TWO_TOGETHER = """
[columns]
n = "cmd"
run = "file"
force_N = "force_two_thrusters_n"
[defaults]
thrusters_per_test = 2
"""
ARM = 0.44  # metres


def column_map(folder: Path, text: str) -> Path:
    path = folder / "columns.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def nominal(tmp_path_factory: pytest.TempPathFactory) -> YawFit:
    """Fitted to the moment that the static curve of the data gives."""
    columns = column_map(tmp_path_factory.mktemp("lake"), NOMINAL)
    return fit_yaw([str(LAKE / "run_*.csv")], columns=columns, jobs=2)


def test_all_ten_runs_are_fitted_whole_with_the_delay_of_the_thrusters(nominal: YawFit) -> None:
    """run_11 jumps by 48 degrees within a sample at 1.4 s, surge speed with it, and by 21 at 6.3 s, and is split; left
    in, the jumps moved the inertia by 40 %."""
    assert nominal.to_json()["fitted_to"] == "whole runs" and len(nominal.read) == 10
    assert nominal.seed_method is None and nominal.why_no_seed_method.startswith("0 of 10 runs")
    assert [aside.run for aside in nominal.set_aside] == ["run_11.1", "run_11.2"]
    assert all("jump of the heading" in aside.why for aside in nominal.set_aside)
    assert not any(warning.startswith("run_11") for warning in nominal.warnings)
    assert nominal.to_json()["command_delay_s"]["ci95"][0] > 0.1  # of 0.44 s


def test_the_model_is_that_of_a_small_boat_and_of_use(nominal: YawFit) -> None:
    """Signs right: else drag would drive. A boat of 29 kg and 1.3 m has some N m s² of inertia before added water. Runs
    left out are predicted 5 s ahead better than by a constant rate or a constant heading."""
    for fit in nominal.output_error.values():
        assert fit.mixed.converged and 5.0 < fit.estimates["I_r"].value < 60.0
    linear = nominal.output_error["1"].estimates["k_r"]
    assert 10.0 < linear.value < 40.0 and linear.ci95[0] > 0
    assert nominal.output_error["3"].estimates["k_rr"].value > 0
    assert nominal.use is not None and nominal.use.of_use
    judged = judged_of(nominal.use.worth["heading"])
    assert judged is not None and judged.horizon == 5.0
    assert np.degrees(judged.error) < 12.0 < np.degrees(judged.constant) < np.degrees(judged.constant_rate)
    assert nominal.use.sentence(YAW).startswith("The model predicts 5 s ahead to ")


def test_commands_through_our_own_bollard_map_agree(nominal: YawFit, tmp_path: Path) -> None:
    """The map fitted to the raw bollard series of two thrusters gives inertia and drag within a quarter."""
    thrusters = fit_thrusters([BOLLARD], columns=column_map(tmp_path, TWO_TOGETHER)).map
    columns = read_column_map(column_map(tmp_path, COMMANDS))
    campaign = load_runs([str(LAKE / "run_*.csv")], columns, dof=YAW)
    runs = [drive_run_by_thrusters(run, thrusters, ARM) for run in campaign.runs]
    assert {run.moment_unit for run in runs} == {"N m"}
    moving = np.zeros(len(runs), dtype=bool)
    course = make_course(runs, moving)
    fit = beside_forecasts(course, fit_driven(course, rough_model("1", make_batch(runs, 0.1)), "1"))
    for name, estimate in fit.estimates.items():
        assert estimate.value == pytest.approx(nominal.output_error["1"].estimates[name].value, rel=0.25)


@pytest.fixture(scope="module")
def halves(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Run], list[Run]]:
    """Half of the runs to fit, the others to hold out, with the surge speed that the logs have."""
    columns = read_column_map(column_map(tmp_path_factory.mktemp("halves"), WITH_SURGE))
    fitted, kept = ([str(LAKE / f"run_{n}.csv") for n in half] for half in (FITTED, LEFT_OUT))
    return list(load_runs(fitted, columns, dof=YAW).runs), list(load_runs(kept, columns, dof=YAW).runs)


def test_a_diagnosis_names_the_delay_and_the_gap_on_runs_left_out_shrinks(halves: tuple[list[Run], list[Run]]) -> None:
    """From the first minute of every run; `make real` has all of them."""
    fitted, kept = ([run.cut(0, min(601, len(run))) for run in half] for half in halves)
    with few_candidates(effects.names(), curves=False):
        found = diagnose_runs(fitted, YawModel.base("1", 25.0, [15.0], "N m", YAW), hold_out=kept)
    assert found.verdict == "named" and found.held_out_gap is not None
    named = {effect.name for effect in found.effects}
    assert named & {"input-delay", "thruster-lag", "dead-band", "cross-coupling"}
    assert found.held_out_gap.after < found.held_out_gap.before
    assert found.held_out_outlook is not None and found.held_out_outlook.density_gain > 0
