"""The moment or force that drives the runs: as logged, or made of thruster commands by a map and an arm."""

from collections.abc import Callable, Sequence
from functools import partial

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.errors import SettingError
from automarine_cli.logs import ColumnMap
from automarine_cli.pipeline.records import Source
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.propulsion import drive_run_by_thrusters


def moment_maker(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, dof: Dof
) -> Callable[[Run], Run] | None:
    """What makes the moment or force of thruster commands, at lever arm `arm` [m] (default: the column map's `arm_m`).

    None without a map: then the logs hold it. Raises SettingError where map or arm is given alone.
    """
    given = map_and_arm(thrusters, arm, columns, dof)
    return None if given is None else partial(drive_run_by_thrusters, thrusters=given[0], arm=given[1])


def map_and_arm(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, dof: Dof
) -> tuple[ThrusterMap, float] | None:
    """The map and the lever arm [m] as given, or None without a map; see `moment_maker`."""
    if not dof.levered and arm is not None:
        levered = " and ".join(one.name for one in DOFS.values() if one.levered)
        raise SettingError(f"--arm is of {levered}; in {dof.name} thrusters push as hard at any arm, so leave it out")
    if thrusters is not None and not dof.thrusters:
        raise SettingError(
            f"--thrusters makes no {dof.words.full_force}; leave it out, and name the {dof.words.force}'s column with "
            "--columns"
        )
    if thrusters is None:
        if arm is not None:
            raise SettingError("--arm goes with the thrusters' map; give --thrusters MAP.json too")
        return None
    length = columns.defaults.get("arm_m") if arm is None else arm
    if not dof.levered:
        length = 1.0  # of no account
    if not isinstance(length, int | float):
        raise SettingError(
            f"--thrusters makes {dof.words.force}s only with the thrusters' lever arm; give --arm METRES"
        )
    known = ThrusterMap.load(thrusters) if isinstance(thrusters, Source) else thrusters
    return known, float(length)


def with_moments(
    runs: Sequence[Run], thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, dof: Dof
) -> tuple[Run, ...]:
    """The runs driven through `thrusters`, or as they are; see `moment_maker`."""
    drive = moment_maker(thrusters, arm, columns, dof)
    return tuple(runs) if drive is None else tuple(drive(run) for run in runs)
