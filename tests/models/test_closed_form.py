"""The closed-form response of models 1 to 3 against scipy's solver, and the numbers that follow from it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tolerances import assert_close

from automarine_cli.models.model import inertia_from_velocity_error, response, steady_rate, velocity_error

INERTIA, K_RR, K_R = 1.018, 1.257, 0.9961  # the source paper's Tables 1 and 2
DRAGS = {"1": (0.5, 0.0), "2": (0.3, 0.9), "3": (0.0, 1.257), "2, negative k_r": (-0.03, 1.29)}


def integrated(time, moment, k_r, k_rr):  # type: ignore[no-untyped-def]
    """Heading and rate by scipy's solver."""

    def slope(t, y):  # type: ignore[no-untyped-def]
        return [y[1], (moment - (k_r + k_rr * abs(y[1])) * y[1]) / INERTIA]

    found = solve_ivp(slope, (0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-10, atol=1e-12, max_step=0.1)
    return found.y


@pytest.mark.parametrize("drag", list(DRAGS.values()), ids=list(DRAGS))
@pytest.mark.parametrize("moment", [-0.8, 0.0, 0.3])
def test_response_for_every_sign_of_moment(moment: float, drag: tuple[float, float]) -> None:
    time = np.linspace(0.0, 9.0, 61)
    heading, rate = response(time, moment, INERTIA, *drag)
    assert_close([heading, rate], integrated(time, moment, *drag), "solve_ivp")
    mirrored = response(time, -moment, INERTIA, *drag)
    assert_close(mirrored, [-heading, -rate], "same arithmetic")
    heading, rate = response(np.array([-2.0, -1.0]), moment, INERTIA, *drag)  # before the switch
    assert heading.tolist() == [0.0, 0.0] and rate.tolist() == [0.0, 0.0]


def test_inputs_broadcast() -> None:
    time, moments = np.linspace(0, 5, 11), np.array([-0.7, 0.2, 0.9])
    together, _ = response(time, moments[:, None], INERTIA, 0.1, 0.8)
    alone = [response(time, moment, INERTIA, 0.1, 0.8)[0] for moment in moments]
    assert_close(together, alone, "same arithmetic")


@pytest.mark.parametrize("tau", [-1.2, 0.1])
def test_printed_equations(tau: float) -> None:
    """Equation 6 for model 1, equation 8 integrated for model 3."""
    time = np.linspace(0, 12, 41)
    six = tau / K_R * time - INERTIA * tau / K_R**2 * (1 - np.exp(-K_R * time / INERTIA))
    assert_close(response(time, tau, INERTIA, K_R, 0.0)[0], six, "closed form")
    x, side = np.sqrt(K_RR * abs(tau)) * time / INERTIA, np.sign(tau)
    eight = side * INERTIA / K_RR * np.log(np.cosh(x)), side * np.sqrt(abs(tau) / K_RR) * np.tanh(x)
    assert_close(response(time, tau, INERTIA, 0.0, K_RR), eight, "closed form")


@pytest.mark.parametrize("tau", [-0.9, 0.2, 1.1])
@pytest.mark.parametrize("drag", list(DRAGS.values()), ids=list(DRAGS))
def test_velocity_error_is_where_the_final_line_meets_the_step(tau: float, drag: tuple[float, float]) -> None:
    late = 60.0
    heading, rate = response(late, tau, INERTIA, *drag)
    assert_close(rate, steady_rate(tau, *drag), "closed form")
    eps = velocity_error(tau, INERTIA, *drag)
    assert_close(heading - rate * late, eps, "closed form")
    assert np.sign(eps) == -np.sign(tau)
    assert_close(inertia_from_velocity_error(eps, tau, *drag), INERTIA, "same arithmetic")


@pytest.mark.parametrize("tau", [-1.0, 0.1, 0.7])
def test_model_2_becomes_equations_7_and_9_at_its_limits(tau: float) -> None:
    seven = -INERTIA * tau / K_R**2
    nine = -np.sign(tau) * INERTIA / K_RR * np.log(2)
    assert_close(velocity_error(tau, INERTIA, K_R, 0.0), seven, "closed form")
    assert_close(velocity_error(tau, INERTIA, 0.0, K_RR), nine, "closed form")
    for small in (1e-6, 1e-9, 1e-12):  # and nothing jumps on the way there
        assert_close(velocity_error(tau, INERTIA, K_R, small), seven * (1 - small), "optimiser")
        assert velocity_error(tau, INERTIA, small, K_RR) == pytest.approx(nine, rel=2 * small / 0.3)
    r_inf = abs(steady_rate(tau, 0.3, 0.9))
    r_2 = r_inf + 0.3 / 0.9  # the two roots of k_rr r² + k_r r - |tau| add up to -k_r/k_rr
    middle = -np.sign(tau) * INERTIA / 0.9 * np.log(1 + r_inf / r_2)
    assert_close(velocity_error(tau, INERTIA, 0.3, 0.9), middle, "closed form")


def test_the_papers_velocity_error_and_its_inertias() -> None:
    """Model 3's velocity error is the same for every moment; put into equation 7 it makes inertia go as 1/tau."""
    taus = np.round(np.arange(0.1, 1.25, 0.1), 1)
    eps = velocity_error(taus, INERTIA, 0.0, K_RR)
    assert_close(-eps, np.full(12, 0.5614), "printed")
    inertias = inertia_from_velocity_error(eps, taus, K_R, 0.0)
    assert inertias[0] == pytest.approx(5.57, abs=0.005) and inertias[-1] == pytest.approx(0.464, abs=5e-4)
    assert inertias[taus >= 0.5].mean() == pytest.approx(0.710, abs=5e-4)
    assert_close(inertia_from_velocity_error(eps, taus, 0.0, K_RR), np.full(12, INERTIA), "same arithmetic")
