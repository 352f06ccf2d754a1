"""`supply_V` of a campaign: thruster tests at another voltage than the vehicle's are told, in numbers that hold."""

import json
import shutil
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
    place = folder / "campaign.toml"
    place.write_text(
        f'schema = "automarine/campaign/1"\n[vehicle]\n{supply}\n[logs]\nthrusters = ["bollard.csv"]\n'
        "[thrusters]\nper_test = 1\n"
    )
    return place


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with tests at 12 and 16 V in `pool`, and its results in `out`."""
    folder = tmp_path_factory.mktemp("supply") / "fitted"
    folder.mkdir()
    run_campaign(campaign(folder / "pool", (12.0, 16.0), "supply_V = 14.0"), out=folder / "out")
    return folder


@pytest.fixture
def supplied(fitted: Path, tmp_path: Path) -> Callable[[float], Path]:
    """The campaign file of a copy with another supply: its map is kept."""

    def at(supply: float) -> Path:
        shutil.copytree(fitted, tmp_path, dirs_exist_ok=True)
        place = tmp_path / "pool" / "campaign.toml"
        place.write_text(place.read_text().replace("14.0", f"{supply}"))
        return place

    return at


@pytest.mark.parametrize("supply", [14.0, 16.3, 11.7])
def test_a_supply_within_the_tests_is_no_news(supplied: Callable[[float], Path], tmp_path: Path, supply: float) -> None:
    found = run_campaign(supplied(supply), out=tmp_path / "out")
    assert found.content.cautions == ()
    assert "Caution" not in (tmp_path / "out" / "report.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("supply", "nearest"), [(22.0, 16.0), (8.0, 12.0)])
def test_a_supply_beyond_the_tests_is_told_with_what_to_expect(
    supplied: Callable[[float], Path], tmp_path: Path, run: Callable[..., Result], supply: float, nearest: float
) -> None:
    place, out = supplied(supply), tmp_path / "out"
    done = run("run", place, "-o", out)
    assert done.exit_code == 0, done.output
    (said,) = json.loads((out / "run.json").read_text(encoding="utf-8"))["cautions"]
    assert said.startswith(f"The thrusters were tested at 12.0 to 16.0 V, the vehicle's supply is {supply:.3g}")
    assert said.endswith("Test at the supply voltage.") and said in " ".join(done.stdout.split())
    words = said.split()
    power, times = float(words[words.index("power") + 1].rstrip(",")), float(words[words.index("times") - 1])
    assert power == pytest.approx(POWER, abs=0.02)
    assert times == pytest.approx((supply / nearest) ** POWER, rel=0.02)
    for name in ("report.html", "report.md"):
        assert "the map is extrapolated" in (out / name).read_text(encoding="utf-8")
    again = run("report", out, "--overwrite")
    assert again.exit_code == 0, again.output
    assert "the map is extrapolated" in (out / "report.md").read_text(encoding="utf-8")


def test_one_voltage_tells_no_power(tmp_path: Path) -> None:
    found = run_campaign(campaign(tmp_path / "pool", (12.0,), "supply_V = 16.0"), out=tmp_path / "out")
    (said,) = found.content.cautions
    assert said == (
        "The thrusters were tested at 12.0 V, the vehicle's supply is 16.0 V: the map is extrapolated. "
        "Test at the supply voltage."
    )


def test_without_a_supply_or_a_voltage_nothing_is_said(tmp_path: Path) -> None:
    found = run_campaign(campaign(tmp_path / "pool", (12.0, 16.0), ""), out=tmp_path / "out")
    assert found.content.cautions == ()
    place = campaign(tmp_path / "other", (12.0,), "supply_V = 40.0")
    log = place.parent / "bollard.csv"
    log.write_text("\n".join(line.rpartition(",")[0] for line in log.read_text().splitlines()) + "\n")
    assert run_campaign(place, out=tmp_path / "more").content.cautions == ()


def test_a_changed_supply_is_told_without_a_new_fit(supplied: Callable[[float], Path], tmp_path: Path) -> None:
    found = run_campaign(supplied(20.0), out=tmp_path / "out")
    assert {one.step: one.did for one in found.steps} == {
        "check": "kept", "fit-thrusters": "kept", "fit-yaw": "skipped", "validate": "skipped",
        "diagnose": "skipped", "report": "done",
    }  # fmt: skip
    assert len(found.content.cautions) == 1


@pytest.mark.parametrize("supply", ["0", "-12.0", '"twelve"', "nan"])
def test_a_supply_that_is_none_is_refused(tmp_path: Path, run: Callable[..., Result], supply: str) -> None:
    found = run("run", campaign(tmp_path / "pool", (12.0,), f"supply_V = {supply}"), "-o", tmp_path / "out")
    assert (found.exit_code, found.stdout) == (1, "")
    assert "vehicle" in found.stderr and "supply_V" in found.stderr and "expected" in found.stderr
    assert not (tmp_path / "out").exists()
