"""Logs become runs: one clock that rises, one unwrapped heading, inputs by name, everything odd counted."""
