"""A run as a file that the vehicle's computer can play: one row a change, held until the next."""

import csv
import io

from automarine_cli.planning.candidates import Candidate
from automarine_cli.planning.drive import Drive

MOMENT_COLUMNS = {"nu": "tau", "N m": "tau_Nm"}
DIGITS = 6


def command_file(candidate: Candidate, rest: float, unit: str, drive: Drive | None) -> str:
    """CSV with `time_s` since the log's start and the moment, or `n_port` and `n_stbd` where a `drive` makes it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("time_s", *((MOMENT_COLUMNS[unit],) if drive is None else ("n_port", "n_stbd"))))
    time = 0.0
    for moment, seconds in ((0.0, rest), *candidate.commands, (0.0, 0.0)):
        values = (moment,) if drive is None else drive.commands(moment)
        writer.writerow((f"{round(time, 3):g}", *(f"{value + 0.0:.{DIGITS}g}" for value in values)))
        time += seconds
    return text.getvalue()


def in_words(candidate: Candidate, unit: str) -> str:
    """What a person is to do, in a line."""
    commands = candidate.commands
    if candidate.kind == "rest":
        return f"nothing for {commands[0][1]:g} s, thrusters idle"
    if candidate.kind == "slow-ramp":
        first, last, total = commands[0][0], commands[-1][0], candidate.driven
        return f"{first:+g} to {last:+g} {unit} in {len(commands)} equal stairs over {total:g} s"
    parts = [
        f"{moment:+g} {unit} for {seconds:g} s" if moment else f"nothing for {seconds:g} s"
        for moment, seconds in commands
    ]
    told = ", then ".join(parts)
    return told if candidate.voltage is None else f"at {candidate.voltage:g} V: {told}"
