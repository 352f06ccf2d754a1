"""The command `simulate`, and what it says to specifications that make no sense."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from specified import read_specification

from automarine_cli.errors import SettingError
from automarine_cli.simulation.campaign import make_plans
from automarine_cli.simulation.specification import Range, moment_text

GOOD = """schema = "automarine/simulation/1"
seed = 3
[vehicle]
I_r = 1.0
k_rr = 1.2
[logger]
noise_deg = 1
[[effects]]
name = "bias-moment"
b = 0.02
[[runs]]
kind = "step"
moments = [0.5, -0.5]
turn_deg = 200
"""
BOAT = GOOD.partition("[vehicle]\n")[2]
INFLOW = '[[effects]]\nname = "rudder-inflow"\nrace = 0\nU = 1\n'
ZIGZAG = '[logger]\n[[runs]]\nkind = "zigzag"\nangles_deg = [10]'


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("noise_deg", "noise_degrees", 'spec.toml: logger: unknown key "noise_degrees"; did you mean "noise_deg"?'),
        ("noise_deg = 1", "rate_hz = -10", "spec.toml: logger: rate_hz is -10; expected more than 0"),
        ("noise_deg = 1", "rate_bias_deg_s = 0.5",
         "spec.toml: logger: rate_bias_deg_s is of the rates logged; expected rate_noise_deg_s with it (0 for none)"),
        ('"step"', '"stepp"', "spec.toml: runs[0].kind: found \"stepp\", expected one of 'step', 'coast-down'"),
        ('"step"', '"planar"', 'spec.toml: runs[0]: unknown key "moments"; known are kind, name'),
        ('"step"', '"ramp"', 'spec.toml: runs[0]: unknown key "moments"; known are kind, name'),
        ('"step"', '"coast-down"', "spec.toml: runs[0]: the kind is coast-down; give coast_s to a coast-down"),
        ("bias-moment", "bias-momnt", "spec.toml: effects[0]: effect 'bias-momnt' is not in the library; known are"),
        ("b = 0.02", "c = 0.02",
         "spec.toml: effects[0]: effect 'bias-moment' has no parameter 'c'; it has b"),
        ("b = 0.02", "", "spec.toml: effects[0]: effect 'bias-moment' needs its parameter 'b' (of b)"),
        ('name = "bias-moment"\nb = 0.02', 'name = "cross-coupling"\nc = 0.1',
         "spec.toml: effects[0]: effect 'cross-coupling' needs the column 'surge', which simulated runs lack; "
         "leave it out"),
        ("turn_deg = 200", "", "spec.toml: runs[0]: expected one of turn_deg and duration_s"),
        ("turn_deg = 200", "turn_deg = 200\ncoast_s = 5", "spec.toml: runs[0]: the kind is step; give coast_s to"),
        ("[0.5, -0.5]", "[0.5, 0]", "spec.toml: runs[0]: moments has a zero; expected other values"),
        ("turn_deg = 200", 'turn_deg = 200\nfolder = "../x"', "spec.toml: runs[0]: folder is '../x'; expected a name"),
        ("turn_deg = 200", "duration_s = 1e9", "spec.toml: 2e+10 samples would be made; expected at most 5e+08"),
        ("[0.5, -0.5]", "[0.5, 0.5]", "spec.toml: two runs would be written as 'tau_+0.5' in runs/tau_+0.5.csv"),
        ("k_rr = 1.2", "", "spec.toml: vehicle: k_rr and k_r are both 0; expected a drag"),
        ("k_rr = 1.2", 'k_rr = 1.2\nmoment_unit = "rad"', "runs: kind 'step' has no rudder; expected zigzag or"),
        ("turn_deg = 200", "turn_deg = 200\nsurge_m_s = 1",
         'spec.toml: runs: a zigzag and surge_m_s are of a rudder; expected moment_unit = "rad"'),
        (BOAT, f'I_r = 1\nk_r = 1\nmoment_unit = "rad"\n{INFLOW}{ZIGZAG}',
         "effects[0]: effect 'rudder-inflow' needs the column 'surge', which simulated runs lack; give surge_m_s"),
        (BOAT, f'I_r = 1e6\nk_r = 1\nmoment_unit = "rad"\n{ZIGZAG}',
         "angles_deg: with 10 no zigzag ends within 120 s; give larger angles"),
    ],
)  # fmt: skip
def test_refused_with_the_key(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    """What is said to the good specification with one thing changed."""
    assert old in GOOD
    path = tmp_path / "spec.toml"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(SettingError) as problem:
        specification = read_specification(path)
        make_plans(specification, specification.seed)
    assert sentence in str(problem.value)


def test_ranges_are_round_and_without_zero() -> None:
    assert Range(-0.3, 0.3, 0.1).values == (-0.3, -0.2, -0.1, 0.1, 0.2, 0.3)
    assert len(Range(-1.2, 1.2, 0.1).values) == 24
    assert [moment_text(m) for m in (0.3, -1.0, 1.25, 30.0)] == ["+0.3", "-1.0", "+1.25", "+30.0"]


def test_the_command_line(run: Callable[..., Result], tmp_path: Path) -> None:
    spec, out = tmp_path / "spec.toml", tmp_path / "out"
    spec.write_text(GOOD)
    assert run("simulate", spec, "-o", out).exit_code == 0
    truth = json.loads((out / "truth.json").read_text())
    assert truth["vehicle"] == {"I_r": 1.0, "k_rr": 1.2, "k_r": 0.0, "moment_unit": "nu"}
    assert (truth["effects"], truth["seed"]) == ([{"name": "bias-moment", "b": 0.02}], 3)
    other = run("simulate", spec, "-o", out, "--overwrite", "--seed", "4", "--json")
    assert json.loads(other.stdout) == json.loads((out / "truth.json").read_text()) != truth
    spec.write_text(GOOD.replace("noise_deg = 1", "noise_deg = -1"))
    refused = run("simulate", spec, "-o", tmp_path / "none")
    assert refused.stderr == "Error: spec.toml: logger: noise_deg is -1; expected 0 or more\n"
    assert refused.exit_code == 1 and not (tmp_path / "none").exists()
