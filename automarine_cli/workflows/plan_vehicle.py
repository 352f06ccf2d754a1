"""What the thrusters and the battery of a planned campaign can give: drive, largest moment, current."""

from collections.abc import Sequence

from automarine_cli.dofs import YAW
from automarine_cli.errors import SettingError
from automarine_cli.logs import ColumnMap
from automarine_cli.pipeline.records import Source
from automarine_cli.planning.candidates import Supply
from automarine_cli.planning.limits import Limits
from automarine_cli.planning.prior_results import PriorResults
from automarine_cli.planning.vehicle import Drive, consumption, drive_of
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.records import Series
from automarine_cli.workflows.moments import map_and_arm

LARGEST_NU = 1.0
"""Largest moment of a normalised model where the limits do not say."""


def drive_for(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, known: PriorResults, limits: Limits
) -> Drive | None:
    """How the thrusters make the model's moments, or None without a map. Raises SettingError, ModelError."""
    given = map_and_arm(thrusters, arm, columns, YAW)
    if given is None:
        return None
    unit = 1.0
    if known.stored.moment_unit == "nu":
        if limits.thrusters.nu_in_Nm is None:
            raise SettingError(
                f"{known.stored.source} is a model of normalised moments, the thruster map gives N m; say what "
                "one unit is "
                "with thrusters.nu_in_Nm in the limits"
            )
        unit = limits.thrusters.nu_in_Nm
    equal = limits.thrusters.pairing == "equal-thrust"
    return drive_of(*given, limits.thrusters.largest_command, equal, unit)


def largest_moment(known: PriorResults, limits: Limits, drive: Drive | None) -> float:
    """The largest moment that runs may have, in the model's unit. Raises SettingError where nothing says it, or the
    thrusters cannot give it."""
    asked, unit = limits.moments.largest, known.stored.moment_unit
    if drive is None:
        if asked is None and unit != "nu":
            raise SettingError(
                f"{known.stored.source} is a model of moments in {unit}; say how large they may be with "
                "moments.largest in the limits (--limits), or give --thrusters and --arm"
            )
        return LARGEST_NU if asked is None else asked
    if asked is not None and asked > drive.largest:
        raise SettingError(
            f"moments.largest is {asked:g} {unit}; the thrusters give at most {drive.largest:.4g} {unit} as they are "
            "paired; ask for less, or pair them by equal commands"
        )
    return drive.largest_rounded if asked is None else asked


def supply_for(
    limits: Limits, largest: float, unit: str, drive: Drive | None, per_test: int, records: Sequence[Series] | None
) -> tuple[Supply, str]:
    """What is drawn from the battery, and a sentence on where that is from: `records` of thruster tests, else the
    limits. Raises SettingError for tests without a drive, RunError for tests without a current or power."""
    battery = limits.battery
    told = f"Battery: {battery.volts:g} V, {battery.charge_Ah:g} Ah; {battery.idle_A:g} A always"
    if records is None:
        why = f"{told} and {battery.full_A:g} A more at {largest:.4g} {unit}, as stated in the limits."
        return Supply(battery.idle_A, battery.full_A, largest), why
    if drive is None:
        raise SettingError(
            "thruster tests give the current only with the thrusters' map; give --thrusters MAP.json and --arm METRES"
        )
    used = consumption(records, per_test, battery.volts)
    ahead, astern = drive.forces(largest)
    full = (used.power(ahead) + used.power(-astern)) / battery.volts
    why = f"{told}, as stated, and {full:.3g} A more at {largest:.4g} {unit}, from the thruster tests."
    return Supply(battery.idle_A, full, largest), why
