"""A bollard file of eight thrusters, one row a reading, with a column that names them."""

import numpy as np

NAMES = tuple(f"T{i}" for i in range(1, 9))
A = 1.0e-4  # N per unit of control squared


def eight(seed: int, differing: dict[str, float] | None = None, column: str = "thruster", noise: float = 0.15) -> str:
    """CSV of n from -400 to 400 for each of eight thrusters; `differing` are factors on the thrust of some."""
    draw = np.random.default_rng(seed)
    lines = [f"n,force_N,{column}"]
    for name in NAMES:
        for n in np.arange(-400.0, 401.0, 50.0):
            force = (differing or {}).get(name, 1.0) * A * n * abs(n) + (draw.normal(0, noise) if n else 0.0)
            lines.append(f"{n:g},{force:.4f},{name}")
    return "\n".join(lines) + "\n"
