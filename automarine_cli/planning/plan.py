"""The result of `plan`: what is still unsure and what a day at the pool allows -> the runs of the next campaign."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automarine_cli.dofs import YAW
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.logs import ColumnMap, LogFile, given_columns
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import Document, Shown, Source, to_mapping
from automarine_cli.pipeline.result_files import PLAN
from automarine_cli.planning.campaign import Campaign, plan_campaign
from automarine_cli.planning.candidates import Slot, Supply
from automarine_cli.planning.limits import Limits, read_limits
from automarine_cli.planning.prior_results import PriorResults, read_prior_results
from automarine_cli.planning.vehicle import Drive, consumption, drive_of
from automarine_cli.thrusters.bollard_data import Series, load_thruster_logs
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.propulsion import map_and_arm

LARGEST_NU = 1.0  # largest moment of a normalised model where the limits do not say
FIT_COMMANDS = {
    "whole-runs": "automarine fit-yaw LOGS --fit-to whole-runs -o out/yaw",
    "half-turns": "automarine fit-yaw LOGS --fit-to half-turns -o out/yaw",
    "diagnosis": "automarine diagnose LOGS --model {model} -o out/diagnosis",
}
"""What the runs are for, by fit."""


@dataclass(frozen=True, repr=False)
class Plan(Shown):
    """A campaign on paper for the file `model`: its drive (None without a map), the names of the logs' `columns`, what
    is drawn from the battery, and a sentence on its `source`."""

    campaign: Campaign
    model: str
    drive: Drive | None
    columns: ColumnMap
    supply: Supply
    source: str
    seed: int

    @property
    def fit_command(self) -> str:
        return FIT_COMMANDS[self.campaign.fitting.fit].format(model=self.model)

    def to_json(self) -> dict[str, Any]:
        campaign, supply = self.campaign, self.supply
        fitting, limits, last = campaign.fitting, campaign.limits, campaign.slots[-1]
        return {
            "schema": PLAN.schema,
            "model": self.model,
            "moment_unit": fitting.model.moment_unit,
            "fit": fitting.fit,
            "fit_command": self.fit_command,
            "planned_for": list(campaign.wanted) or list(campaign.alone),
            "heading_noise_rad": fitting.noise,
            **({} if fitting.rate_noise is None else {"rate_noise_rad_s": fitting.rate_noise}),
            "gain_scatter": fitting.scatter,
            "limits": to_mapping(limits),
            "supply": {"idle_A": supply.idle, "full_A": supply.full, "at_moment": supply.largest},
            "totals": {
                "runs": len(campaign.slots),
                "pool_min": last.ends(limits.runs.rest_before_s) / 60.0,
                "motion_s": campaign.motion,
                "battery_left_Ah": last.left,
                "battery_left_percent": 100.0 * last.left / limits.battery.charge_Ah,
            },
            "planned": self.runs(),
            "parameters": {
                name: {
                    "now": None if name not in campaign.now else campaign.now[name].to_json(),
                    "new_runs": alone.to_json(),
                    "with_earlier_runs": campaign.together[name].to_json() if name in campaign.together else None,
                }
                for name, alone in campaign.alone.items()
            },
            "splits": [
                {"true": split.true, "other": split.other, "evidence": split.evidence,
                 "evidence_of_grid": grid.evidence}
                for split, grid in zip(campaign.splits, campaign.grid_splits)
            ],
            "curves": [to_mapping(curve) for curve in (campaign.plan, campaign.grid, *campaign.more)],
            "notes": [self.source, *campaign.notes],
        }  # fmt: skip

    def runs(self) -> list[dict[str, object]]:
        return [
            {
                "number": slot.number,
                "name": slot.name,
                "kind": slot.candidate.kind,
                "begins_s": slot.begins,
                "start_heading_deg": slot.candidate.start_heading,
                "turn_there_deg": slot.turn_there,
                "turns_deg": slot.turns,
                "voltage_V": slot.candidate.voltage,
                "commands": [[moment, seconds] for moment, seconds in slot.candidate.commands],
                "wait_s": slot.wait,
                "battery_left_Ah": slot.left,
                "command_file": command_path(slot),
                "why": slot.why,
            }
            for slot in self.campaign.slots
        ]


def command_path(slot: Slot) -> str:
    return f"commands/{slot.name}.csv"


def make_plan(
    model: Source,
    *,
    diagnosis: Source | None = None,
    limits: Path | Limits | None = None,
    parameters: tuple[str, ...] = (),
    thruster_tests: Sequence[LogFile] = (),
    thrusters: Source | ThrusterMap | None = None,
    arm: float | None = None,
    columns: Path | Document | ColumnMap | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> Plan:
    """Plan the next campaign for the preferred model of the file `model`, and for the rivals in a `diagnosis`.

    `parameters` are those whose intervals are to shrink (all by default), `limits` say what the pool day allows;
    `thrusters` and `arm` [m] make control signals of moments, and with `thruster_tests` that logged a current or a
    power the battery's use; `seed` draws the order. Raises ModelError, SettingError, LogError or RunError.
    """
    known = read_prior_results(model, diagnosis)
    if not known.model.dof.wraps:
        source, motion = known.stored.source, known.model.dof.name
        raise ModelError(f"{source} is a model of {motion}; give a model of yaw, for no other campaigns are planned")
    limits = limits if isinstance(limits, Limits) else Limits() if limits is None else read_limits(limits)
    names = given_columns(columns)
    drive = _drive(thrusters, arm, names, known, limits)
    largest = _largest_moment(known, limits, drive)
    records = load_thruster_logs(thruster_tests, names, progress=progress).records if thruster_tests else None
    per_test = int(names.defaults.get("thrusters_per_test", 1))
    supply, source = _supply(limits, largest, known.stored.moment_unit, drive, per_test, records)
    campaign = plan_campaign(known, limits, largest, supply, wanted=parameters, seed=seed, progress=progress)
    return Plan(campaign, known.stored.source, drive, names, supply, source, seed)


def _drive(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, known: PriorResults, limits: Limits
) -> Drive | None:
    """How the thrusters make the model's moments, or None without a map. Raises SettingError, ModelError."""
    levered = map_and_arm(thrusters, arm, columns, YAW)
    if levered is None:
        return None
    unit = 1.0 if known.stored.moment_unit != "nu" else limits.thrusters.nu_in_Nm
    if unit is None:
        raise SettingError(
            f"{known.stored.source} is a model of normalised moments, the thruster map gives N m; say what one unit is "
            "with thrusters.nu_in_Nm in the limits"
        )
    return drive_of(*levered, limits.thrusters.largest_command, limits.thrusters.pairing == "equal-thrust", unit)


def _largest_moment(known: PriorResults, limits: Limits, drive: Drive | None) -> float:
    """The largest moment that runs may have, in the model's unit. Raises SettingError where nothing says it, or the
    thrusters cannot give it."""
    largest, unit = limits.moments.largest, known.stored.moment_unit
    if drive is None:
        if largest is None and unit != "nu":
            raise SettingError(
                f"{known.stored.source} is a model of moments in {unit}; say how large they may be with "
                "moments.largest in the limits (--limits), or give --thrusters and --arm"
            )
        return LARGEST_NU if largest is None else largest
    if largest is not None and largest > drive.largest:
        raise SettingError(
            f"moments.largest is {largest:g} {unit}; the thrusters give at most {drive.largest:.4g} {unit} as they are "
            "paired; ask for less, or pair them by equal commands"
        )
    return drive.largest_rounded if largest is None else largest


def _supply(
    limits: Limits, largest: float, unit: str, drive: Drive | None, per_test: int, records: Sequence[Series] | None
) -> tuple[Supply, str]:
    """What is drawn from the battery, and a sentence on where that is from: `records` of thruster tests, else the
    limits. Raises SettingError for tests without a drive, RunError for tests without a current or power."""
    battery = limits.battery
    stated = f"Battery: {battery.volts:g} V, {battery.charge_Ah:g} Ah; {battery.idle_A:g} A always"
    if records is None:
        source = f"{stated} and {battery.full_A:g} A more at {largest:.4g} {unit}, as stated in the limits."
        return Supply(battery.idle_A, battery.full_A, largest), source
    if drive is None:
        raise SettingError(
            "thruster tests give the current only with the thrusters' map; give --thrusters MAP.json and --arm METRES"
        )
    drawn = consumption(records, per_test, battery.volts)
    ahead, astern = drive.forces(largest)
    full = (drawn.power(ahead) + drawn.power(-astern)) / battery.volts
    source = f"{stated}, as stated, and {full:.3g} A more at {largest:.4g} {unit}, from the thruster tests."
    return Supply(battery.idle_A, full, largest), source
