"""What a fit cannot know is said, with the runs to add: in the tables, in the result file and on the terminal."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from identified import identify
from made_campaigns import PAPER, Vehicle, both_ways, campaign
from made_runs import mirrored

from automarine_cli.dofs import YAW
from automarine_cli.estimate import Estimate
from automarine_cli.fits.identify import Caution, YawFit, design_cautions, fit_cautions, seed_cautions, told
from automarine_cli.fits.whole_runs import OutputErrorFit, Preference
from automarine_cli.report import fit_report
from automarine_cli.runs.run import Run

SIZES = (0.3, 0.5, 0.7, 0.9)


def both_tellings(runs: Sequence[Run]) -> list[YawFit]:
    """The fit of the runs, and of the same runs mirrored."""
    return [identify(runs), identify([mirrored(run) for run in runs])]


def said(fit: YawFit, *parts: str) -> bool:
    """Whether one warning holds all the parts."""
    return any(all(part in warning for part in parts) for warning in fit.warnings)


def beside(fit: YawFit, *parts: str) -> bool:
    """Whether one caution holds all the parts, be it a warning or only a note below a table."""
    return any(all(part in caution.sentence for part in parts) for caution in fit.cautions)


@cache
def sound() -> YawFit:
    return identify(campaign(both_ways(SIZES), seed=0, noise_deg=0.5))


def fit_with(name: str, estimate: Estimate) -> dict[str, OutputErrorFit]:
    """Model 3 of a sound campaign with one estimate put in its place."""
    fit = sound().output_error["3"]
    return {"3": replace(fit, estimates={**fit.estimates, name: estimate})}


def test_a_sound_campaign_is_told_nothing_on_the_preferred_model() -> None:
    assert sound().preference.number == "3" and sound().warnings == ()
    assert not [caution for caution in sound().cautions if caution.model in ("", "3")]


# The moments of a campaign


@pytest.mark.parametrize(("sign", "here", "there"), [(1.0, "starboard", "port"), (-1.0, "port", "starboard")])
def test_turns_to_one_side_only_are_told_with_the_side_to_add(sign: float, here: str, there: str) -> None:
    fit = identify(campaign([sign * size for size in (0.2, 0.4, 0.6, 0.8, 1.0)], seed=1))
    assert said(fit, f"Every run turns to {here}", f"add runs to {there} at the same moments")


def test_two_sizes_of_moment_are_told_with_a_third_to_add() -> None:
    for fit in both_tellings(campaign(both_ways((0.4, 0.8)), seed=1)):
        assert said(fit, "two sizes of moment, 0.4 and 0.8 nu", "cannot tell how drag grows", "add runs at 0.2 nu")


def test_the_third_size_is_sought_where_there_is_room() -> None:
    (between,) = design_cautions([0.2, -0.2, 1.0, -1.0], "nu", YAW, of_steps=True)
    assert between.sentence.endswith("add runs at 0.6 nu.")
    assert list(design_cautions([0.2, -0.2, 1.0, -1.0], "nu", YAW, of_steps=False)) == []
    assert list(design_cautions([0.2, -0.2, 0.6, 1.0, -1.0], "nu", YAW, of_steps=True)) == []


def test_moments_all_equal_are_told_with_sizes_to_add() -> None:
    for fit in both_tellings(campaign([0.5, -0.5, 0.5, -0.5], seed=1)):
        assert said(fit, "the same size of moment, 0.5 nu", "add runs at 0.25 and 1 nu")
        assert beside(fit, "Model 2: k_rr and k_r are correlated by -", "much smaller and much larger moments")


# Parameters


def test_a_drag_that_drives_is_told_as_none_that_a_vehicle_has() -> None:
    """Something pushes on at small rates, as an actuator that delivers more than it is told would."""
    runs = campaign(both_ways((0.4, 0.6, 0.8, 1.0)), vehicle=Vehicle(1.0, -0.15, 1.3), seed=1, noise_deg=0.2)
    for fit in both_tellings(runs):
        assert fit.preference.number == "2"
        assert said(fit, "Model 2: k_r is -0.1", "a drag that drives the vehicle", "automarine diagnose")


def test_a_negative_drag_whose_interval_holds_zero_is_left_out_or_measured() -> None:
    (caution,) = fit_cautions(fit_with("k_rr", Estimate(-0.02, 0.03, (-0.08, 0.04), "nu s²")))
    assert "the interval holds zero: take a model without it, or add runs at larger moments" in caution.sentence


def test_a_negative_inertia_is_told() -> None:
    seed = sound().seed_method
    assert seed is not None and list(seed_cautions(replace(seed, drag={}), 0.0, YAW)) == []
    table = replace(seed.inertia["3"], overall=Estimate(-0.4, 0.1, (-0.6, -0.2), "nu s²"))
    (caution,) = seed_cautions(replace(seed, drag={}, inertia={"3": table}), 0.0, YAW)
    assert caution.sentence.startswith("Velocity errors of model 3: I_r is -0.4 [-0.6, -0.2], a negative inertia")


@pytest.mark.parametrize(
    ("name", "remedy"), [("I_r", "add runs from rest, logged faster"), ("k_rr", "add runs at larger moments")]
)
def test_an_interval_wider_than_the_value_is_told_with_what_would_show_it(name: str, remedy: str) -> None:
    (caution,) = fit_cautions(fit_with(name, Estimate(0.2, 0.06, (0.08, 0.32), "nu s²")))
    assert f"Model 3: {name} is 0.2 [0.08, 0.32], an interval wider than the value" in caution.sentence
    assert remedy in caution.sentence and not caution.grave
    assert list(fit_cautions(fit_with(name, Estimate(0.2, 0.04, (0.12, 0.28), "nu s²")))) == []


def test_inertia_that_the_logs_are_too_slow_for_is_told() -> None:
    fit = identify(campaign(vehicle=Vehicle(0.003, 0.0, 1.0), seed=1))
    assert said(fit, "Model 3: I_r is 0.00", "an interval wider than the value", "logged faster")


def test_a_parameter_at_its_bound_is_told_of_every_model() -> None:
    fit = sound().output_error["3"]
    (caution,) = fit_cautions({"3": replace(fit, mixed=replace(fit.mixed, at_bound=(1,)))})
    assert caution.sentence.startswith("Model 3: k_rr stands at a bound of its range") and caution.grave
    assert told([caution], Preference("1", "")) == [caution.sentence]


@pytest.mark.parametrize(("i", "name"), [(0, "I_r"), (1, "k_rr")])
def test_a_parameter_that_never_moved_is_told(i: int, name: str) -> None:
    fit = sound().output_error["3"]
    start = fit.start.copy()
    start[i] = fit.mixed.theta[i]
    covariance = fit.covariance.copy()
    covariance[i] = covariance[:, i] = 0.0
    for stuck in (replace(fit, start=start), replace(fit, covariance=covariance)):
        (caution,) = fit_cautions({"3": stuck})
        assert caution.sentence.startswith(f"Model 3: {name} never moved from its start") and caution.grave


def test_parameters_that_only_act_together_are_told() -> None:
    """Thrust that scatters multiplies inertia and drag alike; two drags at moments close together add up to one."""
    fit = identify(campaign(both_ways(SIZES), seed=0, gain_scatter=0.18))
    assert said(fit, "I_r and k_rr are correlated by 0.9", "only their ratio is well determined")
    close = sound().output_error["3"]
    away = close.mixed.covariance.copy()
    away[0, 1] = away[1, 0] = -0.96 * np.sqrt(away[0, 0] * away[1, 1])
    (caution,) = fit_cautions({"3": replace(close, mixed=replace(close.mixed, covariance=away))})
    assert "correlated by -0.960" in caution.sentence and "until the rate is steady" in caution.sentence


def test_a_wrong_model_converges_or_says_that_it_did_not() -> None:
    """Model 1 fitted to a vehicle of model 3, and the other way about."""
    for vehicle, scatter in ((PAPER, 0.18), (Vehicle(1.0, 1.2, 0.0), 0.0)):
        fit = identify(campaign(both_ways(SIZES), seed=1, vehicle=vehicle, gain_scatter=scatter))
        for number, one in fit.output_error.items():
            assert all(np.isfinite([e.value, e.stderr, *e.ci95]).all() for e in one.estimates.values())
            assert one.mixed.converged != said(fit, f"Model {number} had not converged")


def test_thrust_that_scatters_is_told_where_least_squares_suffer() -> None:
    seed = sound().seed_method
    assert seed is not None
    (caution,) = [one for one in seed_cautions(seed, 0.18, YAW) if one.model == ""]
    assert caution.sentence.startswith("Thrust scatters by 18.0 % from run to run: least squares")
    assert "This bias was removed, assuming normal scatter of the thrust alone" in caution.sentence
    assert not [one for one in seed_cautions(seed, 0.03, YAW) if one.model == ""]


# Where it is told


def test_cautions_stand_below_the_table_of_their_parameter() -> None:
    drag, inertia = Caution("2", ("linear",), "On drag."), Caution("3", ("inertia",), "On inertia.")
    both = Caution("", ("inertia", "quadratic", "linear"), "On both.", grave=True)
    fit = replace(sound(), cautions=(drag, inertia, both), warnings=("On both.",))
    one, two = fit_report.tables(fit)
    assert one.notes[-2:] == ("On drag.", "On both.") and two.notes[-2:] == ("On inertia.", "On both.")
    for form in ("to_markdown", "to_latex", "to_text"):
        assert "On drag." in getattr(one, form)() and "On drag." not in getattr(two, form)()


def test_the_terminal_and_the_result_file_hold_the_warnings() -> None:
    fit = replace(sound(), warnings=("On both.",), cautions=(Caution("2", ("linear",), "On drag."),))
    assert fit.to_json()["warnings"] == ["On both."]
    assert "Warning: On both." in fit_report.sentences(fit)
    assert not any("On drag." in table.to_text() for table in fit_report.tables(fit, short=True))
