"""automarine: identification of ROV and AUV yaw models from open-loop pool tests.

`import automarine_cli as am`, then `am.fit_yaw("logs")` and its like; `am.effects` is the library of effects.
Nothing heavy is imported before one of them is asked for.
"""

from typing import TYPE_CHECKING

from automarine_cli.dofs import DOFS

if TYPE_CHECKING:
    from automarine_cli import effects
    from automarine_cli.workflows.api import (
        check,
        compare,
        diagnose,
        export,
        fit_planar,
        fit_thrusters,
        plan,
        simulate,
        slice_log,
        validate,
    )

__version__ = "0.1.0"
_FITS = tuple(f"fit_{name}" for name in DOFS)
__all__ = [
    "__version__", "check", "compare", "diagnose", "effects", "export", "fit_planar", "fit_thrusters", "plan",
    "simulate", "slice_log", "validate", *_FITS,
]  # fmt: skip


def __getattr__(name: str) -> object:
    """The workflows, and the library of effects, loaded when first asked for."""
    from importlib import import_module

    if name == "effects":
        return import_module(f"{__name__}.effects")
    if name in __all__:
        api = import_module(f"{__name__}.workflows.api")
        found = api.FITS[name] if name in _FITS else getattr(api, name)
        globals()[name] = found
        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
