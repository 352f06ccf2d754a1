"""A campaign that is quick to make and to fit: steps, manoeuvres, a validation run, a bollard test, a campaign file."""

from pathlib import Path

from automarine_cli.commands.simulate import simulate

SPECIFICATION = """
schema = "automarine/simulation/1"
seed = 3
[vehicle]
I_r = 1.018
k_rr = 1.257
moment_unit = "nu"
[logger]
rate_hz = 5
noise_deg = 1
wrap = "0..360"
[scatter]
gain = 0.03
start_heading_deg = "random"
[campaign]
order = "random"
rest_before_s = 3
rest_after_s = 1
wait_between_s = 60
[[runs]]
kind = "step"
folder = "steps"
moments = [-1.0, -0.6, -0.3, 0.3, 0.6, 1.0]
turn_deg = 220
[[runs]]
kind = "step"
folder = "steps"
moments = [-0.6]
turn_deg = 220
suffix = "still"
fault = "never-moves"
[[runs]]
kind = "sequence"
folder = "driving"
name = "to_and_fro"
commands = [[0.8, 6], [-0.8, 7], [0.4, 6]]
[[runs]]
kind = "sequence"
folder = "validation"
name = "there_and_back"
commands = [[0.7, 8], [-0.7, 9], [0.0, 4]]
[bollard]
thrusters_per_test = 2
a_f = 2.6165e-4
a_b = 0.6640e-4
levels = { from = -150, to = 150, step = 30 }
repeats = 2
noise_N = 0.1
folder = "thrusters"
name = "bollard"
"""

CAMPAIGN = """
schema = "automarine/campaign/1"
title = "A small campaign"
[logs]
thrusters = ["thrusters"]
steps = ["steps"]
manoeuvres = ["driving/*.csv"]
validation = ["validation"]
[thrusters]
per_test = 2
"""


def make_small_campaign(folder: Path) -> Path:
    """Simulate the logs into `folder` and write its campaign file, whose path is returned."""
    folder.mkdir(parents=True, exist_ok=True)
    specification = folder.parent / f"{folder.name}.simulated.toml"
    specification.write_text(SPECIFICATION, encoding="utf-8")
    simulate(specification, out=folder)
    (folder / "manifest.json").unlink()
    campaign = folder / "campaign.toml"
    campaign.write_text(CAMPAIGN, encoding="utf-8")
    return campaign
