"""Everything automarine refuses, one class a room; the command line turns each into one line and exit status 1.

A message is one clear sentence: where (file, row, column), what was found, what was expected, what to do. What to do
is a clause that begins with a verb; for a value that a person wrote, what was expected in its place may say it.
"""


class AutomarineError(Exception):
    """Root of all refusals; never raised itself."""


class LogError(AutomarineError):
    """A log or a column map that cannot be read right."""


class RunError(AutomarineError):
    """Unusable runs: too few left, or a run that was named and cannot be used."""


class TooFewRunsError(RunError):
    """Too few runs for what was asked of them: more would have to be made."""


class SettingError(AutomarineError):
    """A recipe, specification or option value that makes no sense."""


class ModelError(AutomarineError):
    """A model or thruster map that cannot be loaded, or an effect that does not exist."""


class FitError(AutomarineError):
    """A fit whose data cannot carry it."""


class OutputError(AutomarineError):
    """Results that cannot or must not be written."""
