"""`automarine fit-thrusters` from end to end: options, files, terminal, refusals."""

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from matplotlib.figure import Figure

from automarine_cli.commands.compare import compare
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.commands.options import OneOf
from automarine_cli.report import thruster_tables
from automarine_cli.report.campaign import headlines, read_steps
from automarine_cli.report.figures.thrusters import thruster_figure
from automarine_cli.report.tables import number
from automarine_cli.thrusters.map import FORMS, ThrusterMap

FILES = ("thrusters.json", "thrusters.csv", "thrusters.md", "thrusters.png")
Run = Callable[..., Result]
AHEAD, ASTERN = 5.233e-4, 1.328e-4  # the source paper's equation 3, two thrusters together
LEVELS = np.arange(-150.0, 151.0, 10.0)


def write(path: Path, header: str, *columns: np.ndarray) -> Path:
    rows = "\n".join(",".join(f"{value:.10g}" for value in row) for row in zip(*columns))
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")
    return path


def two_thrusters(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * n * np.abs(n)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(LEVELS))
    noise[LEVELS == 0] = 0.0
    return write(tmp_path / "bollard.csv", "n,force_N", LEVELS, two_thrusters(LEVELS) + noise)


def test_how_many_pulled_is_told_where_nobody_said_it(run: Run, log: Path, tmp_path: Path) -> None:
    alone = run("fit-thrusters", log)
    assert "One thruster is taken to have pulled in each test" in " ".join(alone.stdout.split())
    columns = tmp_path / "map.toml"
    columns.write_text("[defaults]\nthrusters_per_test = 2\n")
    for said in (("--thrusters-per-test", 1), ("--columns", columns)):
        assert "is taken to have pulled" not in run("fit-thrusters", log, *said).stdout


def supplies(path: Path, header: str) -> Path:
    """A test at five voltages: at one command thrust goes with the square of the voltage."""
    volts, n = np.meshgrid([10.0, 12.0, 14.0, 16.0, 20.0], np.arange(-100.0, 101.0, 10.0))
    force = 0.004 * n * np.abs(n) * (volts / 16.0) ** 2
    return write(path, header, n.ravel(), force.ravel(), volts.ravel())


def test_one_command_with_many_thrusts_asks_for_the_supply(run: Run, tmp_path: Path) -> None:
    log = supplies(tmp_path / "volts.csv", "n,force_N,nominal_supply_volts")
    found = run("fit-thrusters", log)
    assert found.exit_code == 1 and len(found.stderr.splitlines()) == 1
    assert "the same command 100 gave 15.6 to 62.5 N" in found.stderr or "the same command -100 gave" in found.stderr
    assert "does nominal_supply_volts (10 to 20) hold the supply?" in found.stderr
    columns = tmp_path / "map.toml"
    columns.write_text('[columns]\nvoltage_V = "nominal_supply_volts"\n')
    assert "A map for each voltage" in run("fit-thrusters", log, "--columns", columns).stdout


def test_what_changed_for_another_reason_throws_no_point_out(tmp_path: Path) -> None:
    fit = fit_thrusters([supplies(tmp_path / "other.csv", "n,force_N,seen_by")], thrusters_per_test=1)
    assert set(fit.points.flag) == {""}
    assert any("something else changed between tests, and the map is a mean" in note for note in fit.notes)


def test_the_error_over_all_points_stands_beside_that_by_weight(tmp_path: Path) -> None:
    force = two_thrusters(LEVELS)
    force[-3] = 0.0  # the load cell dropped out
    fit = fit_thrusters([write(tmp_path / "out.csv", "n,force_N", LEVELS, force)], thrusters_per_test=1)
    data = fit.to_json()
    off = fit.points.force - fit.analysis.fitted(fit.points.n, square=True)
    assert data["rmse_all_points_N"] == pytest.approx(np.sqrt(np.mean(off**2)))
    assert data["rmse_all_points_N"] > 3 * data["rmse_N"]  # type: ignore[operator]
    assert "Over all points alike the rmse is" in repr(thruster_tables.tables(fit)[0].notes)


def test_an_offset_of_the_load_cell_is_offered_as_such(run: Run, tmp_path: Path) -> None:
    """Volts that fall with thrust either way, 0.0175 at rest, as a scale with the other sign makes newtons of them."""
    volts = 0.0175 - two_thrusters(LEVELS) / 5209.0
    log = write(tmp_path / "cell.csv", "n,v_load_V", LEVELS, volts)
    columns = tmp_path / "map.toml"
    columns.write_text('[columns]\nforce_N = { from = "v_load_V", scale = -5209 }\n')
    found = run("fit-thrusters", log, "--columns", columns)
    assert found.exit_code == 0 or "the force at command 0 is -91.2 N" in found.stderr
    shifted = write(tmp_path / "cell.csv", "n,v_load_V", LEVELS, 0.0175 - np.abs(two_thrusters(LEVELS)) / 5209.0)
    found = run("fit-thrusters", shifted, "--columns", columns)
    assert found.exit_code == 1
    assert "the force at command 0 is -91.16 N, which looks like the offset of the load cell" in found.stderr
    assert "Write subtract = 0.0175 in the line of the force" in found.stderr


def test_equation_three_from_end_to_end(run: Run, log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("fit-thrusters", log, "--thrusters-per-test", 2, "-o", out)
    assert result.exit_code == 0, result.output
    data = json.loads((out / "thrusters.json").read_text(encoding="utf-8"))
    assert data["schema"] == "automarine/thruster-map/1" and data["thrusters_per_test"] == 2
    for side, truth in (("forward", AHEAD), ("backward", ASTERN)):
        one, both = data[side]["a"], data["per_test"][side]["a"]
        assert both["value"] == pytest.approx(2 * one["value"], rel=1e-12)
        assert both["ci95"][0] < truth < both["ci95"][1]
        assert data[side]["points"] == 15
    assert data["r2"] > 0.99 and data["cv_rmse_N"] >= data["rmse_N"] > 0
    assert [form["form"] for form in data["forms"]][:2] == ["square", "dead-band"] and len(data["forms"]) == 8
    assert data["form"] == "square" and data["chosen_because"] in result.stdout
    assert data["runs"] == {"used": 1, "set_aside": []}
    thruster_map = ThrusterMap.from_json(data)
    assert thruster_map.force(100.0) == pytest.approx(1e4 * data["forward"]["a"]["value"])
    assert sorted(path.name for path in out.iterdir()) == sorted([*FILES, "manifest.json"])
    rows = list(csv.DictReader(io.StringIO((out / "thrusters.csv").read_text(encoding="utf-8"))))
    assert len(rows) == len(LEVELS)
    assert float(rows[-1]["force_N"]) == pytest.approx(float(rows[-1]["fitted_N"]) + float(rows[-1]["residual_N"]))
    assert "**Forms side by side" in (out / "thrusters.md").read_text(encoding="utf-8")
    assert (out / "thrusters.png").read_bytes().startswith(b"\x89PNG")


def test_json_alone_and_the_column_maps_default(run: Run, log: Path, tmp_path: Path) -> None:
    columns = tmp_path / "columns.toml"
    columns.write_text("[defaults]\nthrusters_per_test = 2\n", encoding="utf-8")
    data = json.loads(run("fit-thrusters", log, "--columns", columns, "--json").stdout)
    assert data["thrusters_per_test"] == 2
    overruled = json.loads(run("fit-thrusters", log, "--columns", columns, "--thrusters-per-test", 1, "--json").stdout)
    assert overruled["thrusters_per_test"] == 1
    assert overruled["forward"]["a"]["value"] == pytest.approx(2 * data["forward"]["a"]["value"])


def test_forced_form_keeps_the_square_law_beside_it(run: Run, log: Path) -> None:
    data = json.loads(run("fit-thrusters", log, "--form", "power", "--json").stdout)
    assert data["form"] == "power" and data["chosen"]["form"] == "power"
    assert data["parameters"]["forward"]["p"]["value"] == pytest.approx(2.0, abs=0.1)
    assert data["forward"]["a"]["value"] == pytest.approx(AHEAD, rel=0.02)
    assert run("fit-thrusters", log, "--form", "cubic").exit_code == 2


def test_flagged_points_are_printed_and_kept(run: Run, tmp_path: Path) -> None:
    force = two_thrusters(LEVELS) + 0.02 * np.random.default_rng(1).standard_normal(len(LEVELS))
    force[26] = 0.0
    log = write(tmp_path / "faulty.csv", "n,force_N", LEVELS, force)
    result = run("fit-thrusters", log)
    assert "1 of 31 points have reduced weight" in result.stdout and "dropped out" in result.stdout
    data = json.loads(run("fit-thrusters", log, "--json").stdout)
    assert data["flagged"][0]["n"] == 110.0 and data["flagged"][0]["weight"] < 0.01
    assert data["forward"]["points"] == 15
    assert data["forward"]["a"]["value"] == pytest.approx(AHEAD, rel=0.01)


@pytest.mark.slow
def test_voltage_gives_a_map_each_and_the_exponent(run: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    volts = np.repeat([10.0, 12.0, 14.0, 16.0], len(LEVELS))
    n = np.tile(LEVELS, 4)
    force = two_thrusters(n) * (volts / 12.0) ** 1.2 * (1 + 0.003 * rng.standard_normal(len(n)))
    sagging = volts * (1 - 0.002 * np.abs(n) / 150)
    log = write(tmp_path / "volts.csv", "n,force_N,voltage_V", n, force, sagging)
    data = json.loads(run("fit-thrusters", log, "--json").stdout)
    assert data == json.loads(run("fit-thrusters", log, "--json", "--jobs", 2).stdout)
    assert len(data["voltages"]) == 4
    for entry, step in zip(data["voltages"], (10.0, 12.0, 14.0, 16.0)):
        assert entry["voltage_V"] == pytest.approx(step, rel=0.003)
        assert entry["forward"]["a"]["value"] == pytest.approx(AHEAD * (step / 12) ** 1.2, rel=0.01)
    for side in ("forward", "backward"):
        estimate = data["voltage_exponent"][side]["thrust_at_fixed_n"]
        assert abs(estimate["value"] - 1.2) < 4 * estimate["stderr"] + 0.01
        assert data["voltage_exponent"][side]["a"]["value"] == pytest.approx(1.2, abs=0.03)
        assert len(data["voltage_exponent"][side]["between"]) == 3
    assert any("that voltage's map" in note for note in data["notes"])


def test_figure_has_measured_points_both_curves_and_residuals(log: Path) -> None:
    figure = thruster_figure(fit_thrusters([log]))
    assert isinstance(figure, Figure)
    thrust, residual = figure.axes
    assert thrust.get_ylabel() == "Thrust of one thruster [N]"
    assert residual.get_xlabel() == "Control signal n [unit as logged]"
    assert residual.get_ylabel().endswith("[N]")
    labels = [text.get_text() for text in thrust.get_legend().get_texts()]
    assert {"square law (chosen)", "measured"} <= set(labels)
    curved = thruster_figure(fit_thrusters([log], form="power"))
    assert {"square law", "chosen: power"} <= {text.get_text() for text in curved.axes[0].get_legend().get_texts()}
    for axes in figure.axes:
        for line in axes.get_lines():
            assert np.all(np.isfinite(np.asarray(line.get_ydata(), dtype=float)))


def test_one_direction_and_missing_values(run: Run, tmp_path: Path) -> None:
    log = tmp_path / "ahead.csv"
    log.write_text("n,force_N\n1,2\n2,8\n,3\n3,18\n4,\n5,50\n6,72\n", encoding="utf-8")
    result = run("fit-thrusters", log)
    assert result.exit_code == 0 and "no backward points" in result.stdout
    assert "2 rows without a control signal or a force" in result.stdout
    data = json.loads(run("fit-thrusters", log, "--json").stdout)
    assert data["backward"] == {"a": None, "points": 0, "levels": 0, "why": "no backward points"}
    assert data["forward"]["a"]["value"] == pytest.approx(2.0)
    assert ThrusterMap.from_json(data).force(2.0) == pytest.approx(8.0, rel=1e-6)


def test_other_logs_in_a_folder_are_set_aside_or_refused(run: Run, log: Path, tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    folder.mkdir()
    log.rename(folder / "bollard.csv")
    (folder / "yaw.csv").write_text("time_s,heading_deg,tau\n0,0,1\n1,2,1\n", encoding="utf-8")
    result = run("fit-thrusters", folder)
    assert result.exit_code == 0 and "yaw.csv" in result.stderr and "control signal" in result.stderr
    data = json.loads(run("fit-thrusters", folder, "--json").stdout)
    assert data["runs"]["set_aside"][0]["file"].endswith("yaw.csv")
    for arguments in ([folder, "--strict"], [folder / "yaw.csv"]):
        refused = run("fit-thrusters", *arguments)
        assert refused.exit_code == 1 and refused.stderr.startswith("Error: ") and refused.stderr.count("\n") == 1


def test_refusals_are_one_line(run: Run, tmp_path: Path) -> None:
    log = write(tmp_path / "wrong.csv", "n,force_N", LEVELS, -two_thrusters(LEVELS))
    out = tmp_path / "out"
    result = run("fit-thrusters", log, "-o", out)
    assert result.exit_code == 1 and "sign = -1" in result.stderr and not out.exists()
    columns = tmp_path / "columns.toml"
    columns.write_text('[columns]\nforce_N = { from = "force_N", sign = -1 }\n', encoding="utf-8")
    assert run("fit-thrusters", log, "--columns", columns).exit_code == 0


def test_the_command_offers_every_form() -> None:
    form = next(one for one in fit_thrusters.params if one.name == "form")
    assert isinstance(form.type, OneOf) and set(form.type.names()) == {"auto", *FORMS}


@pytest.fixture
def throttle(tmp_path: Path) -> Path:
    """Thrust against a throttle: far from the square law, with a dead band and no saturation."""
    n = np.arange(-20, 21) / 20.0
    thrust = 60.0 * np.sign(n) * np.maximum(np.abs(n) - 0.1, 0.0) ** 1.2
    noise = 0.1 * np.random.default_rng(2).standard_normal(len(n))
    return write(tmp_path / "throttle.csv", "n,force_N", n, thrust + noise)


def test_the_map_that_is_used_comes_with_its_own_error(throttle: Path, tmp_path: Path) -> None:
    out = tmp_path / "thrusters"
    fit = fit_thrusters([throttle], out=out)
    analysis = fit.analysis
    own, law = (number(analysis.percent(one.rmse), 3) for one in (analysis.chosen, analysis.law))
    assert analysis.chosen.form.name == "dead-band-power" and float(own) < 1.0 < 5.0 < float(law)
    lines = repr(fit).splitlines()
    assert lines[0] == f"Chosen form dead-band-power: {analysis.chosen.form.equation}" and "a |n| n" not in lines[0]
    first, second = (i for i, line in enumerate(lines) if line.startswith("R² "))
    assert f"= {own} % of" in lines[first] and f"= {law} % of" in lines[second]
    assert "One thruster is taken to have pulled in each test" in repr(fit)
    text = (out / "thrusters.md").read_text(encoding="utf-8")
    assert text.index("Chosen form dead-band-power") < text.index("Square law F") and f"= {own} % of" in text
    assert (
        f"error {number(analysis.percent(analysis.chosen.rmse), 2)} %"
        in headlines(read_steps(out.parent))["fit-thrusters"]
    )
    frame = fit.to_frame()
    chosen = frame[frame["form"] == "dead-band-power"].set_index(["parameter", "direction"])
    assert set(frame["form"]) == {"dead-band-power", "square"} and len(chosen) == 6
    assert chosen.loc[("n_0", "forward"), "value"] == pytest.approx(0.1, abs=0.01)


def test_maps_with_a_parameter_at_its_bound_are_shown_and_compared(throttle: Path, tmp_path: Path) -> None:
    form = "dead-band-power-saturation"
    fits = [fit_thrusters([throttle], out=tmp_path / name, form=form) for name in ("a", "b")]
    assert "no saturation within the measured range" in repr(fits[0])
    frame = fits[0].to_frame().set_index(["form", "parameter", "direction"])
    assert np.isnan(frame.loc[(form, "n_sat", "forward"), "value"])
    found = compare([tmp_path / "a", tmp_path / "b"])
    named = [one.parameter for one in found.differences]
    assert f"p forward, form {form}" in named and f"n_sat forward, form {form}" not in named
    assert found.sides[0].facts[f"n_sat forward, form {form}"] == "no saturation within the measured range"
