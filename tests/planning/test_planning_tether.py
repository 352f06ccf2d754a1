"""How far planned runs turn, and the ways back that keep the tether untwisted."""

import numpy as np
import pytest

from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.planning.campaign import headings_of, ways_back
from automarine_cli.planning.candidates import Candidate
from automarine_cli.planning.information import Logger

MODEL = YawModel.base("3", 1.0, [1.25], "nu", YAW)
LOGGER = Logger(YAW, "nu", 10.0, 2.0, None, None)


def test_a_run_turns_as_the_closed_form_says() -> None:
    runs = [Candidate("step", str(m), ((m, 8.0),)) for m in (0.5, -0.5, 1.0)]
    runs.append(Candidate("reversal", "r", ((0.5, 4.0), (-0.5, 4.0))))
    found = np.rad2deg([heading[-1] for heading in headings_of(MODEL, LOGGER, runs)])
    # I r' = tau - k r|r|, so psi = I / k log cosh(sqrt(k tau) t / I); half a sample passes before a command shows
    right = [np.sign(m) * np.log(np.cosh(np.sqrt(1.25 * abs(m)) * 7.95)) / 1.25 for m in (0.5, -0.5, 1.0)]
    assert found[:3] == pytest.approx(np.rad2deg(right), rel=1e-3)
    assert found[0] == pytest.approx(-found[1]) and abs(found[3]) < found[0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_whole_turns_are_turned_back(sign: float) -> None:
    turned, headings = sign * np.array([1000.0, 400.0, -100.0, 30.0]), [0.0, 90.0, 180.0, 270.0]
    back = ways_back(turned, headings)
    twist = np.cumsum(back) + np.concatenate([[0.0], np.cumsum(turned[:-1])])
    assert back[0] == 0.0 and np.abs(twist).max() <= 180.0
    assert np.allclose((twist - headings) % 360.0, 0.0)  # and each run starts where it should
    assert back[1] == 90.0 - sign * 1000.0
    assert list(ways_back(sign * np.array([10.0, 0.0]), [0.0, 180.0])) == [
        0.0,
        sign * 170.0,
    ]  # either half turn will do
