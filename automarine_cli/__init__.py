"""automarine: identification of ROV and AUV yaw models from open-loop pool tests.

`import automarine_cli as am`, then `am.fit_yaw("logs")` and its like; `am.effects` is the library of effects.
Nothing heavy is imported before one of them is asked for.
"""

from typing import TYPE_CHECKING, Any

from automarine_cli.dofs import DOFS

if TYPE_CHECKING:
    from automarine_cli import effects
    from automarine_cli.workflows.check import check
    from automarine_cli.workflows.compare import compare
    from automarine_cli.workflows.diagnose import diagnose
    from automarine_cli.workflows.export import export
    from automarine_cli.workflows.fit_planar import fit_planar
    from automarine_cli.workflows.fit_thrusters import fit_thrusters
    from automarine_cli.workflows.plan import plan
    from automarine_cli.workflows.simulate import simulate
    from automarine_cli.workflows.slice import slice_log
    from automarine_cli.workflows.validate import validate

__version__ = "0.1.0"
_FITS = tuple(f"fit_{name}" for name in DOFS)
__all__ = [
    "__version__", "check", "compare", "diagnose", "effects", "export", "fit_planar", "fit_thrusters", "plan",
    "simulate", "slice_log", "validate", *_FITS,
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """The commands, and the library of effects, loaded when first asked for."""
    from importlib import import_module
    from importlib.util import find_spec

    if name == "effects":
        return import_module(f"{__name__}.effects")
    if not name.startswith("_") and find_spec(f"{__name__}.{name}") is None:
        found = import_module(f"{__name__}.workflows.command").commands()
        globals().update({one.__name__: one for one in found.values()})
    if name in globals():
        return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
