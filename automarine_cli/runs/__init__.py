"""Logs become runs: one clock that rises, one unwrapped position, inputs by name, everything odd counted."""
