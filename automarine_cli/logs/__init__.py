"""Log files of any format become `LogTable`s: canonical columns in SI units, row numbers for messages."""

from automarine_cli.logs.columns import ColumnMap, ColumnRule, column_rules, given_columns, read_column_map
from automarine_cli.logs.find import Logs, find_logs, whole_logs, with_joined
from automarine_cli.logs.formats import LogFile
from automarine_cli.logs.table import (
    LogTable,
    is_let_go,
    is_thruster_test,
    read_log,
    require,
    require_motion,
    require_thruster,
)

__all__ = [
    "ColumnMap", "ColumnRule", "LogFile", "LogTable", "Logs", "column_rules", "find_logs", "given_columns",
    "is_let_go", "is_thruster_test", "read_column_map", "read_log", "require", "require_motion", "require_thruster",
    "whole_logs", "with_joined",
]  # fmt: skip
