"""The only room with matplotlib: one module a command, each function returns a `matplotlib.figure.Figure`."""
