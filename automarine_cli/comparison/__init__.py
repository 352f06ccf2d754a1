"""Simulation against measurement: residuals and the scores made of them."""
