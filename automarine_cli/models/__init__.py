"""The yaw model: inertia and a tuple of effects with values; closed forms of models 1 to 3; files."""
