"""automarine: identification of ROV and AUV yaw models from open-loop pool tests.

`import automarine_cli as am`, then `am.fit_yaw("logs")` and its like; `am.effects` is the library of effects.
Nothing heavy is imported before one of them is asked for.
"""

from typing import Any

__version__ = "0.1.0"
__all__ = [
    "__version__", "check", "compare", "diagnose", "effects", "export", "fit_heave", "fit_pitch", "fit_planar",
    "fit_roll", "fit_surge", "fit_sway", "fit_thrusters", "fit_yaw", "plan", "predict", "samples", "simulate",
    "slice_log", "tune", "validate",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """The commands, and the library of effects, loaded when first asked for."""
    from importlib import import_module
    from importlib.util import find_spec

    if name == "effects":
        return import_module(f"{__name__}.effects")
    if not name.startswith("_") and find_spec(f"{__name__}.{name}") is None:
        commands = import_module(f"{__name__}.commands")
        if name in commands.in_python():
            function = commands.load(commands.in_python()[name])
            function.__doc__ = import_module(f"{__name__}.commands.command").python_help(function)
            globals()[name] = function
    if name in globals():
        return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
