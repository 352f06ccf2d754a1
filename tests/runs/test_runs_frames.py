"""Speeds and places along other axes than their columns say are named; those of other axes that are right are not."""

import numpy as np
import pytest

from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.quantities import Floats
from automarine_cli.runs.frames import FIXED, MIRRORED, frame_warnings
from automarine_cli.runs.run import Run

TIME = np.arange(0.0, 90.0, 0.1)
HEADING = 0.3 * np.sin(0.2 * TIME) + 0.01 * TIME + 0.4
AHEAD, ABEAM = 1.2 - 0.2 * np.cos(0.2 * TIME), 0.15 * np.cos(0.2 * TIME)
NORTH = np.cumsum(AHEAD * np.cos(HEADING) - ABEAM * np.sin(HEADING)) * 0.1
EAST = np.cumsum(AHEAD * np.sin(HEADING) + ABEAM * np.cos(HEADING)) * 0.1
PLACES = {"north": NORTH, "east": EAST}


def warnings(heading: Floats = HEADING, *, speeds: bool = True, **places: Floats) -> tuple[str, ...]:
    """What is said of two runs with a little noise, with or without logged speeds."""
    noise = np.random.default_rng(3).normal(size=(4, len(TIME)))
    extras = {name: column + 0.05 * shaken for (name, column), shaken in zip(places.items(), noise)}
    extras[SURGE.command] = 20.0 + 0.0 * TIME
    if speeds:
        extras |= {SURGE.velocity: AHEAD + 0.05 * noise[2], SWAY.velocity: ABEAM + 0.05 * noise[3]}
    run = Run("a", "a.csv", TIME, heading, 0.0 * TIME, "N m", extras, dof=YAW)
    return frame_warnings([run, run])


@pytest.mark.parametrize("speeds", [True, False])
class TestPlaces:
    def test_of_the_heading_are_not_named(self, speeds: bool) -> None:
        assert warnings(speeds=speeds, **PLACES) == ()

    def test_read_once_a_second_are_not_named(self, speeds: bool) -> None:
        seldom = {name: np.where(np.arange(len(TIME)) % 10 == 0, column, np.nan) for name, column in PLACES.items()}
        assert warnings(speeds=speeds, **seldom) == ()
        exchanged = dict(zip(seldom, reversed(seldom.values())))
        assert warnings(speeds=speeds, **exchanged) == (MIRRORED,)

    def test_exchanged_or_mirrored_are_named(self, speeds: bool) -> None:
        assert warnings(speeds=speeds, north=EAST, east=NORTH) == (MIRRORED,)
        assert warnings(-HEADING, speeds=speeds, **PLACES) == (MIRRORED,)

    @pytest.mark.parametrize("turn", [60.0, -90.0, 180.0])
    def test_turned_are_named_with_the_angle(self, speeds: bool, turn: float) -> None:
        (sentence,) = warnings(HEADING + np.deg2rad(turn), speeds=speeds, **PLACES)
        said = float(sentence.split(" deg ")[0].split()[-1])
        assert said == pytest.approx(abs(turn), abs=3.0)

    def test_by_a_compass_that_errs_are_not_named(self, speeds: bool) -> None:
        assert warnings(HEADING + np.deg2rad(10.0), speeds=speeds, **PLACES) == ()


def test_speeds_along_fixed_axes_are_named() -> None:
    over_ground = {
        SURGE.velocity: AHEAD * np.cos(HEADING) - ABEAM * np.sin(HEADING),
        SWAY.velocity: AHEAD * np.sin(HEADING) + ABEAM * np.cos(HEADING),
    }
    run = Run("a", "a.csv", TIME, HEADING, 0.0 * TIME, "N m", over_ground, dof=YAW)
    assert frame_warnings([run]) == (FIXED,)
    assert warnings() == ()
