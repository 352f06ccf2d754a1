"""Estimators: pure functions from runs (or points) to parameters with intervals."""
