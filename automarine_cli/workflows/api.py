"""What `import automarine_cli as am` offers: the workflows, called as one calls things at a prompt.

Each takes places as strings too, one log as well as many, and a result where a file of that result is wanted:
`am.validate("pool/day2", model=am.fit_yaw("pool/day1"))`.
"""

import tempfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

from automarine_cli.fits.planar_fit import PlanarFit
from automarine_cli.fits.yaw_fit import YawFit
from automarine_cli.pipeline.outputs import json_text
from automarine_cli.thrusters.result import ThrusterFit
from automarine_cli.workflows import check as _check
from automarine_cli.workflows import compare as _compare
from automarine_cli.workflows import diagnose as _diagnose
from automarine_cli.workflows import export as _export
from automarine_cli.workflows import fit_planar as _fit_planar
from automarine_cli.workflows import fit_thrusters as _fit_thrusters
from automarine_cli.workflows import fit_yaw as _fit_yaw
from automarine_cli.workflows import plan as _plan
from automarine_cli.workflows import simulate as _simulate
from automarine_cli.workflows import slice as _slice
from automarine_cli.workflows import validate_planar as _validate
from automarine_cli.workflows.diagnose import YawDiagnosis
from automarine_cli.workflows.diagnose_planar import PlanarDiagnosis

Result = TypeVar("Result")

MANY = ("logs", "hold_out", "results", "thruster_tests", "parameters")
FILES = ("model", "thrusters", "columns", "out", "specification", "diagnosis", "limits")
STORED: Mapping[type, tuple[str, Callable[[Any], object]]] = {
    YawFit: ("yaw_model.json", YawFit.to_json),
    PlanarFit: ("planar_model.json", PlanarFit.to_json),
    ThrusterFit: ("thrusters.json", ThrusterFit.to_json),
    YawDiagnosis: ("extended_model.json", YawDiagnosis.extended_model),
    PlanarDiagnosis: ("extended_model.json", PlanarDiagnosis.extended_model),
}
"""Results that stand for a file: its name and content."""
DIAGNOSIS: tuple[str, Callable[[Any], object]] = ("diagnosis.json", YawDiagnosis.to_json)
"""What a diagnosis stands for where a diagnosis, and no model, is wanted."""


def at_a_prompt(work: Callable[..., Result], first: str) -> Callable[..., Result]:
    """The workflow with easier arguments; `first` is the name of the one that needs no name."""

    @wraps(work)
    def call(*given: object, **settings: object) -> Result:
        if len(given) == 1:
            settings = {first: given[0], **settings}
        elif given:
            raise TypeError(
                f"{len(given)} arguments without a name; give {first} alone so, as a list if they are many"
            )
        with ExitStack() as stack:
            plain = {name: _plain(name, value, stack) for name, value in settings.items()}
            return work(**plain)

    return call


def _plain(name: str, value: object, stack: ExitStack) -> object:
    """The argument as workflows take it; a result that stands for a file is stored in a folder for the time being."""
    if name in MANY and isinstance(value, str | Path):
        return [value]
    if name in FILES and isinstance(value, str):
        return Path(value)
    if name in FILES and type(value) in STORED:
        file, content = DIAGNOSIS if name == "diagnosis" else STORED[type(value)]
        path = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="automarine-"))) / file
        path.write_text(json_text(content(value)), encoding="utf-8")
        return path
    return value


check = at_a_prompt(_check.check, "logs")
fit_thrusters = at_a_prompt(_fit_thrusters.fit_thrusters, "logs")
fit_planar = at_a_prompt(_fit_planar.fit_planar, "logs")
FITS = {f"fit_{name}": at_a_prompt(fit, "logs") for name, fit in _fit_yaw.FITS.items()}
"""`fit_yaw`, `fit_surge` and their like, by name."""
validate = at_a_prompt(_validate.validate_any, "logs")
diagnose = at_a_prompt(_diagnose.diagnose_any, "logs")
simulate = at_a_prompt(_simulate.simulate, "specification")
slice_log = at_a_prompt(_slice.slice_log, "logs")
compare = at_a_prompt(_compare.compare, "results")
export = at_a_prompt(_export.export, "model")
plan = at_a_prompt(_plan.plan, "model")
