"""`supply_V` of a campaign: a supply that the thruster tests do not reach is a caution."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from automarine_cli.commands.run import run_campaign

POWER = 1.5  # thrust grows so with the voltage
COEFFICIENT = 2.6e-4  # N/n² at 12 V


def campaign(folder: Path, volts: tuple[float, ...], supply: str) -> Path:
    """A campaign of one bollard test, pulled at each of these voltages; `supply` is a line of the file."""
    rng = np.random.default_rng(5)
    folder.mkdir()
    levels = np.repeat(np.arange(-150, 151, 15), 2)
    rows = [
        f"{n},{COEFFICIENT * n * abs(n) * (v / 12.0) ** POWER + 0.01 * rng.normal():.5f},{v + 0.02 * rng.normal():.3f}"
        for v in volts
        for n in levels[levels != 0]
    ]
    (folder / "bollard.csv").write_text("\n".join(["n,force_N,voltage_V", *rows, ""]))
    file = folder / "campaign.toml"
    file.write_text(
        f'schema = "automarine/campaign/1"\n[vehicle]\n{supply}\n[logs]\nthrusters = ["bollard.csv"]\n'
        "[thrusters]\nper_test = 1\n"
    )
    return file


@pytest.mark.parametrize(("supply", "beyond"), [(16.3, False), (11.7, False), (22.0, True), (8.0, True)])
def test_a_supply_beyond_the_tests_is_a_caution(
    tmp_path: Path, run: Callable[..., Result], supply: float, beyond: bool
) -> None:
    out = tmp_path / "out"
    result = run("run", campaign(tmp_path / "pool", (12.0, 16.0), f"supply_V = {supply}"), "-o", out)
    assert result.exit_code == 0, result.output
    lines = json.loads((out / "run.json").read_text(encoding="utf-8"))["cautions"]
    pages = [(out / name).read_text(encoding="utf-8") for name in ("report.html", "report.md")]
    assert all(("the map is extrapolated" in page) == beyond for page in pages) and len(lines) == beyond
    for caution in lines:
        assert caution.startswith(f"The thrusters were tested at 12.0 to 16.0 V, the vehicle's supply is {supply:.3g}")
        assert caution.endswith("Test at the supply voltage.") and caution in " ".join(result.stdout.split())


def test_without_any_voltage_nothing_is_said(tmp_path: Path) -> None:
    file, out = campaign(tmp_path / "pool", (12.0,), "supply_V = 16.0"), tmp_path / "out"
    (caution,) = run_campaign(file, out=out).content.cautions
    assert "tested at 12.0 V, the vehicle's supply is 16.0 V" in caution
    file.write_text(file.read_text().replace("16.0", "20.0"))
    result = run_campaign(file, out=out)
    assert {step.step: step.did for step in result.steps}["fit-thrusters"] == "kept"
    assert "20.0 V" in result.content.cautions[0]
    log = tmp_path / "pool" / "bollard.csv"
    log.write_text("\n".join(line.rpartition(",")[0] for line in log.read_text().splitlines()) + "\n")
    assert run_campaign(file, out=out).content.cautions == ()
