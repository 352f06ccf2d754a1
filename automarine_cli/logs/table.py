"""What every log becomes, whatever its format."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Labels:
    """A column of words: the `names` in the order in which they first appear, and `code`, shape (N,), which of them
    each row has (-1: none)."""

    names: tuple[str, ...]
    code: NDArray[np.int64]


@dataclass(frozen=True)
class LogTable:
    """One log file, read: canonical columns in SI units, each of shape (N,).

    `columns` holds the canonical quantities that the file has, under these names:
    `time` [s], `heading` [rad, as logged: wrapped or not], `yaw_rate` [rad/s], `moment` [`moment_unit`],
    `n_port`, `n_stbd`, `n` [the file's own unit], `voltage` [V], `surge`, `sway` [m/s], `force` [N]; in a log of
    another motion (`dof`) its position [m] and force (see `dofs.Dof`) [`moment_unit`] in place of heading and moment;
    every other numeric column stays in `extras` under the file's own name. In a log of motion in the plane `columns`
    also holds velocities and commands of its other degrees of freedom, `north` and `east` [m], `lat` and `lon` [rad].
    `units` are those of the columns' names: what tells newtons from a normalised force.
    A missing value is NaN. `rows` are 1-based line numbers in the file (Parquet: row numbers), for messages.
    `names` are all column names of the file, `notes` what a person should know about the reading. In a file of several
    runs `run_names` are theirs in the order in which they begin, and `run_code` says for each row which it is.
    `states` are the vehicle's mode and arming where the file tells them, `holds` the messages or topics of the file.
    """

    source: str
    columns: Mapping[str, Floats]
    rows: NDArray[np.int64]
    run_names: tuple[str, ...] = ()
    run_code: NDArray[np.int64] | None = None
    moment_unit: str | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    dof: Dof = field(kw_only=True)
    extras: Mapping[str, Floats] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    states: Mapping[str, Labels] = field(default_factory=dict)
    holds: tuple[str, ...] = ()

    @property
    def run(self) -> NDArray[np.str_] | None:
        """The name of each row's run, shape (N,), or None where the file is one run."""
        return None if self.run_code is None else np.array(self.run_names)[self.run_code]

    def __len__(self) -> int:
        return len(self.rows)
