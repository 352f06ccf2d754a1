"""Thrusters alone: bollard tests, thrust curves and their fit, the map of a thruster, what a map lacks."""
