"""`supply_V` of a campaign: a supply that the thruster tests do not reach is a caution."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from click.testing import Result

from automarine_cli.commands.run import run_campaign

POWER = 1.5  # thrust grows so with the voltage
COEFFICIENT = 2.6e-4  # N/n² at 12 V


def campaign(folder: Path, volts: tuple[float, ...]) -> Path:
    """A campaign of one bollard test, pulled at each of these voltages, and of a supply of 16 V."""
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
        'schema = "automarine/campaign/1"\n[vehicle]\nsupply_V = 16.0\n[logs]\nthrusters = ["bollard.csv"]\n'
        "[thrusters]\nper_test = 1\n"
    )
    return file


def test_a_supply_beyond_the_tests_is_a_caution(tmp_path: Path, run: Callable[..., Result]) -> None:
    file, out = campaign(tmp_path / "pool", (12.0, 16.0)), tmp_path / "out"
    text = file.read_text()
    for supply, beyond in ((16.3, False), (11.7, False), (22.0, True), (8.0, True)):
        file.write_text(text.replace("16.0", f"{supply}"))
        result = run("run", file, "-o", out)
        assert result.exit_code == 0, result.output
        content = json.loads((out / "run.json").read_text(encoding="utf-8"))
        pages = [(out / name).read_text(encoding="utf-8") for name in ("report.html", "report.md")]
        assert all(("the map is extrapolated" in page) == beyond for page in pages)
        assert len(content["cautions"]) == beyond
        for caution in content["cautions"]:
            assert f"tested at 12.0 to 16.0 V, the vehicle's supply is {supply:.3g}" in caution
            assert caution in " ".join(result.stdout.split())
    assert {step.step: step.did for step in run_campaign(file, out=out).steps}["fit-thrusters"] == "kept"
    log = tmp_path / "pool" / "bollard.csv"
    log.write_text("\n".join(line.rpartition(",")[0] for line in log.read_text().splitlines()) + "\n")
    assert run_campaign(file, out=out).content.cautions == ()  # of tests without any voltage nothing is said
