"""What a fit leaves: closed forms of the autocorrelation, and fits of runs whose noise is white."""

import numpy as np
import pytest
from identified import identify
from made_campaigns import both_ways, campaign

from automarine_cli.fits.characteristics import autocorrelation, correlations, standardised_residuals

LAGS = 5


@pytest.mark.parametrize("memory", [0.0, 0.6, -0.4])
def test_autocorrelation_of_a_process_of_first_order(memory: float) -> None:
    """It is the power of the lag; pooled over runs of several lengths, and no pair reaches over two runs."""
    rng, runs = np.random.default_rng(7), []
    for count in (4000, 9000, 7000):
        values = rng.standard_normal(count)
        for i in range(1, count):
            values[i] += memory * values[i - 1]
        runs.append(values)
    assert autocorrelation(runs, LAGS) == pytest.approx(memory ** np.arange(1, LAGS + 1), abs=4.0 / np.sqrt(20000))
    assert autocorrelation([np.array([1.0, 1.0]), np.array([-1.0, -1.0])], 1) == pytest.approx([0.5])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_residuals_of_a_right_model_are_white_and_as_large_as_the_noise(seed: int) -> None:
    fit = identify(campaign(both_ways((0.2, 0.5, 0.8, 1.1)), seed=seed, gain_scatter=0.02))
    residuals = standardised_residuals(fit.preferred, fit.runs, fit.data, fit.use)
    left = [values for _, values in residuals]
    assert len(residuals) == 8 and all(len(time) == len(values) for time, values in residuals)
    assert float(np.concatenate(left).std()) == pytest.approx(1.0, abs=0.1)
    assert abs(float(np.concatenate(left).mean())) < 0.1 and abs(float(autocorrelation(left, 1)[0])) < 0.15
    names, matrix = correlations(fit.preferred)
    assert names[0] == "yaw.I_r" and np.diagonal(matrix) == pytest.approx(1.0)
    assert matrix == pytest.approx(matrix.T) and np.all(np.abs(matrix) <= 1.0 + 1e-9)
