"""`automarine init`: what the columns of logs are taken for, and that it asks where it is not sure."""

import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_campaigns import campaign

from automarine_cli.commands.init import init
from automarine_cli.commands.run import run_campaign
from automarine_cli.logs.recognise import places_of
from automarine_cli.report.campaign_file import NewCampaign
from automarine_cli.runs.run import Run

Column = Callable[[Run], Any]
MOMENTS = (0.4, -0.4, 0.8, -0.8)
TIME: dict[str, Column] = {"time_s": lambda run: run.time}
HEADING: dict[str, Column] = {"heading_deg": lambda run: np.rad2deg(run.position) % 360}
MOMENT: dict[str, Column] = {"tau": lambda run: run.command}
CANONICAL = TIME | HEADING | MOMENT


def write_table(path: Path, columns: Mapping[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [",".join(columns), *(",".join(map(str, row)) for row in zip(*np.broadcast_arrays(*columns.values())))]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def write_logs(folder: Path, columns: Mapping[str, Column], moments: tuple[float, ...] = MOMENTS) -> Path:
    """Step runs of known truth as CSV files, each column made of the run."""
    for run in campaign(moments, noise_deg=0.3):
        write_table(folder / f"{run.name}.csv", {name: column(run) for name, column in columns.items()})
    return folder


def started(folder: Path, **how: Any) -> tuple[NewCampaign, dict[str, Any]]:
    """What `init` makes of a folder, and the data in its campaign file."""
    result = init(folder, overwrite=True, **how)
    return result, tomllib.loads(result.text)


def answer(folder: Path, answers: Mapping[str, str]) -> Path:
    """The campaign file of a folder, its questions answered."""
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    for key, value in answers.items():
        text, count = re.subn(rf'^({key} = .*)"\?"', rf"\g<1>{value}", text, flags=re.MULTILINE)
        assert count == 1, key
    file.write_text(text, encoding="utf-8")
    return file


RADIANS: Column = lambda run: (run.position + np.pi) % (2 * np.pi) - np.pi  # noqa: E731
ROTATIONS: dict[str, tuple[dict[str, Column], dict[str, Any], tuple[str, ...], tuple[str, ...]]] = {
    "canonical": (
        CANONICAL, {}, (),
        ("# heading_deg", "wraps at 360; turns with the moment in 4 of 4 steps", "4 runs, -0.800 to 0.800 nu"),
    ),
    "other names and units": (
        {"T (ms)": lambda run: 1000 * run.time, "Yaw (rad)": RADIANS, "tau_Nm": MOMENT["tau"]},
        {"time_ms": "T (ms)", "heading_rad": "Yaw (rad)"}, (), ("wraps at 2 pi", "100 from sample to sample"),
    ),
    "a unit that contradicts its range": (
        CANONICAL | {"heading_deg": lambda run: run.position % (2 * np.pi)},
        {"heading_deg": {"from": "heading_deg", "unit": "?"}}, ("columns.heading_deg.unit",),
        ("# ? the name says deg, the range says rad; seen: 0",),
    ),
    "a sign that contradicts the moment": (
        CANONICAL | {"heading_deg": lambda run: np.rad2deg(-run.position) % 360},
        {"heading_deg": {"from": "heading_deg", "sign": "?"}}, ("columns.heading_deg.sign",),
        ("turns with the moment in 0 of 4 steps",),
    ),
    "a moment without a unit": (
        TIME | HEADING | {"torque": MOMENT["tau"]}, {"tau": "?"}, ("columns.tau",),
        ('(then tau_Nm = "torque") or normalised (then tau = "torque")?',),
    ),
    "no heading": (
        TIME | {"q7": HEADING["heading_deg"]} | MOMENT, {"heading_deg": "?"}, ("columns.heading_deg",),
        ("no column looks like the heading; the logs have time_s, q7, tau",
         "4 logs; 4 of them show what they are once the questions are answered"),
    ),
    "thruster commands": (
        TIME | HEADING | {"port": lambda run: run.command, "stbd": lambda run: -run.command},
        {"n_port": "port", "n_stbd": "stbd"}, ("vehicle.arm_m", "thrusters.map"), ('moment = "thrusters"',),
    ),
    "pulses and a light": (
        TIME | HEADING | {
            "C1": lambda run: 1500 + 400 * run.command, "C2": lambda run: 1500 - 400 * run.command,
            "light": lambda run: 1100 + 0 * run.time,
        },
        {"tau": "?"}, ("columns.tau",),
        ('such as C1, C2 are written n_port = { from = "C1", subtract = 1500 }',),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROTATIONS)
def test_columns_of_runs(tmp_path: Path, name: str) -> None:
    columns, rules, questions, texts = ROTATIONS[name]
    write_logs(tmp_path / "logs", columns)
    result, data = started(tmp_path)
    assert (data["columns"], result.questions) == (rules, questions)
    assert [text for text in texts if text not in result.text] == []
    assert data["logs"]["steps"] == ["logs"]  # by the likelier reading, where there is a question
    if name == "a sign that contradicts the moment":
        file = answer(tmp_path, {"heading_deg": "-1"})
        assert run_campaign(file, out=tmp_path / "out", until="check").says["check"] == "4 logs, 4 runs"


@pytest.mark.parametrize(("name", "rules"), [("time", {}), ("Timestamp", {"time": "Timestamp"})])
def test_timestamps_are_a_clock(tmp_path: Path, name: str, rules: dict[str, str]) -> None:
    def stamps(run: Run) -> list[str]:
        return [f"2026-05-01T12:{int(t) // 60:02d}:{t % 60:06.3f}" for t in run.time + 9]

    write_logs(tmp_path / "logs", {name: stamps} | HEADING | MOMENT)
    result, data = started(tmp_path)
    assert (result.questions, data["columns"], data["logs"]["steps"]) == ((), rules, ["logs"])


PWM = np.arange(1100.0, 1901.0, 25.0)
AHEAD, ASTERN = 3.0e-4, 2.3e-4  # N per us squared
FORCE = np.where(PWM > 1500, AHEAD, -ASTERN) * (PWM - 1500) ** 2
KGF = FORCE / 9.80665
PERCENT = (PWM - 1100) / 8
PULSES = {"from": "PWM_us", "unit": "us", "subtract": 1500}
HALF = {"from": "throttle_pct", "subtract": 50.0}
SIGNALS: list[tuple[dict[str, Any], dict[str, Any], tuple[str, ...]]] = [
    # pulses; the neutral by the sign of the force; the same under a name without a unit
    ({"PWM_us": PWM, "force_kgf": KGF}, {"n": PULSES}, ()),
    ({"cmd": PWM, "force_N": FORCE}, {"n": PULSES | {"from": "cmd"}}, ()),
    # pulses of a wide range, and of a name that says no more than the unit
    ({"PWM_us": 1500 + 2.25 * (PWM - 1500), "force_kgf": KGF}, {"n": PULSES}, ()),
    ({"input (us)": PWM[18:], "force_N": FORCE[18:]}, {"n": PULSES | {"from": "input (us)"}}, ()),
    # unsigned speed, directed by the force; signed speed
    ({"rpm": np.round(9.5 * np.abs(PWM - 1500)), "force_N": FORCE}, {"n": {"from": "rpm", "sign_from": "force_N"}}, ()),
    ({"RPM": PWM - 1500, "Force (Kg f)": KGF}, {"n": "RPM", "force_kgf": "Force (Kg f)"}, ()),
    # a force of one sign, directed by the command
    ({"PWM_us": PWM, "thrust_kg": np.abs(KGF)},
     {"n": PULSES, "force_kgf": {"from": "thrust_kg", "sign_from": {"from": "PWM_us", "subtract": 1500}}}, ()),
    # percent about 50; from 0, ahead only; of both ways with a force of one sign
    ({"throttle_pct": PERCENT, "load_N": FORCE}, {"n": HALF, "force_N": "load_N"}, ()),
    ({"throttle_pct": PERCENT, "load_N": PERCENT**2 / 78}, {"n": "throttle_pct", "force_N": "load_N"}, ()),
    ({"throttle_pct": PERCENT, "load_N": np.abs(FORCE)},
     {"n": HALF, "force_N": {"from": "load_N", "sign_from": HALF}}, ()),
    # thrust is a throttle where another column is the force, and asked about where none is
    ({"thrust": (PWM - 1500) / 400, "load_kg": KGF}, {"n": "thrust", "force_kgf": "load_kg"}, ()),
    ({"PWM_us": PWM, "thrust": (PWM - 1500) / 400}, {"n": PULSES, "force_N": "?"}, ("columns.force_N",)),
    # volts of a load cell are no supply and no force; a supply under load is
    ({"PWM_us": PWM, "load_V": 0.013 + 1e-4 * FORCE}, {"n": PULSES, "force_N": "?"}, ("columns.force_N",)),
    ({"PWM_us": PWM, "force_N": FORCE, "v_load_V": 16 - 0.01 * np.abs(FORCE)},
     {"n": PULSES, "voltage_V": "v_load_V"}, ()),
    # a load without a unit; ahead is logged as negative force
    ({"PWM_us": PWM, "load": FORCE}, {"n": PULSES, "force_N": {"from": "load", "unit": "?"}},
     ("columns.force_N.unit",)),
    ({"PWM_us": PWM, "force_N": -FORCE}, {"n": PULSES, "force_N": {"from": "force_N", "sign": "?"}},
     ("columns.force_N.sign",)),
]  # fmt: skip


@pytest.mark.parametrize(("columns", "rules", "questions"), SIGNALS, ids=[" ".join(case[0]) for case in SIGNALS])
def test_signals(tmp_path: Path, columns: dict[str, Any], rules: dict[str, Any], questions: tuple[str, ...]) -> None:
    write_table(tmp_path / "bench" / "a.csv", columns)
    result, data = started(tmp_path)
    assert data["columns"] == rules and data["logs"]["thrusters"] == ["bench"]
    assert result.questions == (*questions, "thrusters.per_test")
    if questions and "sign" not in questions[0]:
        return  # there is no force
    file = answer(tmp_path, {"per_test": "1"} | ({"force_N": "-1"} if questions else {}))
    done = run_campaign(file, out=tmp_path / "out", until="fit-thrusters")
    assert "R² 1.000" in done.says["fit-thrusters"] or "R² 0.99" in done.says["fit-thrusters"]


@pytest.mark.parametrize(
    ("wanted", "others", "places"),
    [
        (["a/1.csv", "a/2.csv"], ["b/1.csv"], ["a"]),
        (["a/x/1.csv", "a/y/2.csv"], ["b/1.csv"], ["a"]),
        (["1.csv", "2.csv"], [], ["*.csv"]),
        (["1.csv", "2.csv"], ["3.parquet"], ["*.csv"]),
        (["a/tau_1.csv", "a/tau_2.csv"], ["a/coast_1.csv", "tau_1.csv"], ["a/tau_*"]),
        (["tau_+0.5.csv", "tau_-0.5.csv"], ["coast_+0.5.csv"], ["tau_*"]),
        (["x.csv"], ["y.csv"], ["x.csv"]),
        (["[1].csv", "[2].csv"], ["y.csv"], ["[1].csv", "[2].csv"]),
    ],
)
def test_places_mean_exactly_what_is_wanted(wanted: list[str], others: list[str], places: list[str]) -> None:
    assert places_of(wanted, [*wanted, *others]) == places
