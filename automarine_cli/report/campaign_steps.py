"""The steps of a campaign as data: what each is called, where its result is, which logs it takes, what it needs."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.pipeline.result_files import (
    CHECK,
    DIAGNOSIS,
    MODELS,
    PLANAR_MODEL,
    THRUSTER_MAP,
    TUNING,
    VALIDATION,
    ResultKind,
)

REPORT = "report"


@dataclass(frozen=True)
class Step:
    """A step: its name, its folder, the kind of its result, and the section of the campaign file with its settings.

    `logs` are kinds of logs: those of the first tuple of which there are any are taken, or all logs where there is no
    section. `models` are files of results before it, of which it takes the first that is there.
    """

    name: str
    folder: str
    kind: ResultKind[Any]
    section: str = ""
    logs: tuple[tuple[str, ...], ...] = ()
    models: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """The command that it runs."""
        return self.kind.writer

    @property
    def always(self) -> bool:
        """Whether every campaign has it."""
        return self.section in ("", "thrusters", YAW.name)


def folder_of(dof: Dof, step: str) -> str:
    """Name the folder of "validation" or "diagnosis" of a motion; yaw, which every campaign has, needs no name."""
    return step if dof is YAW else f"{dof.name}_{step}"


def _of(motion: str, fit: ResultKind[Any], fitted: tuple[tuple[str, ...], ...]) -> Iterator[Step]:
    """The steps of one motion, or of surge, sway and yaw together."""
    after, before = ("", "") if motion == YAW.name else (f"-{motion}", f"{motion}_")
    models = (f"{motion}/{fit.file}",)
    yield Step(f"fit-{motion}", motion, fit, motion, fitted)
    yield Step(f"validate{after}", f"{before}validation", VALIDATION, motion, (("validation",),), models)
    everything = tuple(kind for kinds in fitted for kind in kinds)
    yield Step(f"diagnose{after}", f"{before}diagnosis", DIAGNOSIS, motion, (everything,), models)


STEPS = (
    Step("check", "check", CHECK),
    Step("fit-thrusters", "thrusters", THRUSTER_MAP, "thrusters", (("thrusters",),)),
    *(step for motion in DOFS for step in _of(motion, MODELS[motion], (("steps",), ("manoeuvres",)))),
    *_of(PLANAR.name, PLANAR_MODEL, (("runs",),)),
    Step("tune", "tune", TUNING, "tune", models=(f"diagnosis/{DIAGNOSIS.file}", f"yaw/{MODELS[YAW.name].file}")),
)
STEP_NAMES = (*(step.name for step in STEPS), REPORT)
