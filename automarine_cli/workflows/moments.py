"""The moment that drives the runs: as logged, or made of thruster commands by a map and an arm."""

from collections.abc import Sequence
from pathlib import Path

from automarine_cli.errors import SettingError
from automarine_cli.logs import ColumnMap
from automarine_cli.models.propulsion import drive_by_thrusters
from automarine_cli.models.thruster_map import ThrusterMap
from automarine_cli.pipeline.recipe import read_mapping
from automarine_cli.runs.run import Run


def with_moments(
    runs: Sequence[Run], thrusters: Path | ThrusterMap | None, arm: float | None, columns: ColumnMap
) -> tuple[Run, ...]:
    """The runs driven through `thrusters` at lever arm `arm` [m] (default: the column map's `arm_m`).

    Without a map the runs stay as they are. Raises SettingError where map or arm is given without the other.
    """
    arm = columns.defaults.get("arm_m") if arm is None else arm  # type: ignore[assignment]
    if thrusters is None:
        if arm is not None and not columns.defaults:
            raise SettingError(
                "--arm says how far the thrusters sit off the centre line; give their map too: --thrusters "
                "MAP.json"
            )
        return tuple(runs)
    if arm is None:
        raise SettingError("--thrusters makes moments only with the thrusters' lever arm; give --arm METRES")
    if isinstance(thrusters, Path):
        thrusters = ThrusterMap.from_json(read_mapping(thrusters), thrusters.name)
    return drive_by_thrusters(runs, thrusters, float(arm))
