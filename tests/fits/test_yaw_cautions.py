"""What a fit cannot know is said, with the runs to add: in the tables, in the result file and on the terminal."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from identified import identify
from made_campaigns import Vehicle, both_ways, campaign
from made_runs import mirrored

from automarine_cli.estimate import Estimate
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.preference import Preference
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.report.fit_report import cautions_of, fit_cautions, warnings_of

SIZES = (0.3, 0.5, 0.7, 0.9)
TO_ONE_SIDE, ALIKE = [0.2, 0.4, 0.6, 0.8, 1.0], [0.5, -0.5, 0.5, -0.5]


def says(fit: YawFit, *parts: str) -> bool:
    """Whether one caution holds all the parts, be it a warning or only a note below a table."""
    sentences = [*fit.warnings, *(caution.sentence for caution in cautions_of(fit))]
    return any(all(part in sentence for part in parts) for sentence in sentences)


@cache
def sound() -> YawFit:
    return identify(campaign(both_ways(SIZES), seed=0, noise_deg=0.5))


def fit_with(name: str, estimate: Estimate) -> dict[str, OutputErrorFit]:
    """Model 3 of a sound campaign with one estimate put in its place."""
    fit = replace(sound().output_error["3"])
    vars(fit)["estimates"] = {**fit.estimates, name: estimate}
    return {"3": fit}


@pytest.mark.parametrize(
    ("moments", "how", "cautions"),
    [
        (TO_ONE_SIDE, {}, [("Every run turns to starboard", "add runs to port at the same moments")]),
        (TO_ONE_SIDE, {"mirror": True}, [("Every run turns to port", "add runs to starboard at the same moments")]),
        (
            ALIKE, {"mirror": True},
            [
                ("the same size of moment, 0.5 nu", "add runs at 0.25 and 1 nu"),
                ("Model 2: k_rr and k_r are correlated by -", "much smaller and much larger moments"),
            ],
        ),
        (
            both_ways((0.1, 0.3, 0.5, 0.7, 0.9, 1.1)), {"vehicle": Vehicle(0.003, 0.0, 1.0)},
            [("Model 3: I_r is 0.00", "an interval wider than the value", "logged faster")],
        ),
        (
            both_ways(SIZES), {"seed": 0, "gain_scatter": 0.18},  # which multiplies inertia and drag alike
            [("I_r and k_rr are correlated by 0.9", "only their ratio is well determined")],
        ),
    ],
)  # fmt: skip
def test_the_runs_to_add(moments: Sequence[float], how: dict[str, Any], cautions: list[tuple[str, ...]]) -> None:
    runs = campaign(moments, **{"seed": 1, **{key: value for key, value in how.items() if key != "mirror"}})
    fit = identify([mirrored(run) for run in runs] if "mirror" in how else runs)
    assert [parts for parts in cautions if not says(fit, *parts)] == []


def test_a_sound_campaign_is_told_nothing_on_the_preferred_model() -> None:
    assert sound().preference.number == "3" and sound().warnings == ()
    assert not [caution for caution in cautions_of(sound()) if caution.model in ("", "3")]


def test_a_drag_that_drives_is_told_as_none_that_a_vehicle_has() -> None:
    """Something pushes on at small rates, as an actuator that delivers more than it is told would."""
    runs = campaign(both_ways((0.4, 0.6, 0.8, 1.0)), vehicle=Vehicle(1.0, -0.15, 1.3), seed=1, noise_deg=0.2)
    for fit in (identify(runs), identify([mirrored(run) for run in runs])):
        assert fit.preference.number == "2"
        assert says(fit, "Model 2: k_r is -0.1", "a drag that drives the vehicle", "automarine diagnose")
    (caution,) = fit_cautions(fit_with("k_rr", Estimate(-0.02, 0.03, (-0.08, 0.04), "nu s²")))
    assert "the interval holds zero: take a model without it, or add runs at larger moments" in caution.sentence


@pytest.mark.parametrize(
    ("name", "remedy"), [("I_r", "add runs from rest, logged faster"), ("k_rr", "add runs at larger moments")]
)
def test_an_interval_wider_than_the_value_is_told_with_what_would_show_it(name: str, remedy: str) -> None:
    (caution,) = fit_cautions(fit_with(name, Estimate(0.2, 0.06, (0.08, 0.32), "nu s²")))
    assert f"Model 3: {name} is 0.2 [0.08, 0.32], an interval wider than the value" in caution.sentence
    assert remedy in caution.sentence and not caution.grave
    assert list(fit_cautions(fit_with(name, Estimate(0.2, 0.04, (0.12, 0.28), "nu s²")))) == []


@pytest.mark.parametrize("i", [0, 1])
def test_a_parameter_at_its_bound_or_that_never_moved_is_told_of_every_model(i: int) -> None:
    fit, name = sound().output_error["3"], ("I_r", "k_rr")[i]
    covariance = fit.covariance.copy()
    covariance[i], covariance[:, i] = 0.0, 0.0
    for stuck, sentence in (
        (replace(fit, covariance=covariance), "never moved from its start"),
        (replace(fit, mixed=replace(fit.mixed, at_bound=(i,))), "and stands at a bound of its range"),
    ):
        (caution,) = fit_cautions({"3": stuck})
        assert caution.sentence.startswith(f"Model 3: {name} ") and sentence in caution.sentence and caution.grave
        other = replace(sound(), output_error={**sound().output_error, "3": stuck}, preference=Preference("1", ""))
        assert caution.sentence in warnings_of(other)


def test_parameters_that_only_act_together_are_told() -> None:
    fit = sound().output_error["3"]
    away = fit.mixed.covariance.copy()
    away[0, 1] = away[1, 0] = -0.96 * np.sqrt(away[0, 0] * away[1, 1])
    (caution,) = fit_cautions({"3": replace(fit, mixed=replace(fit.mixed, covariance=away))})
    assert "correlated by -0.960" in caution.sentence and "until the rate is steady" in caution.sentence
