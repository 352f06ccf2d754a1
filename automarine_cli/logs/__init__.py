"""Log files of any format become `LogTable`s: canonical columns in SI units, row numbers kept for messages."""
