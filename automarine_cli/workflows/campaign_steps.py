"""The steps of a campaign in order: which logs and settings each takes, or why it has nothing to do."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from automarine_cli.dofs import DOFS, YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.logs import LogFile
from automarine_cli.pipeline.manifest import why_made_again
from automarine_cli.pipeline.progress import Progress
from automarine_cli.pipeline.records import Record
from automarine_cli.report.campaign_steps import StepFolder
from automarine_cli.results.kinds import DIAGNOSIS, MODELS
from automarine_cli.workflows.campaign_file import Campaign, Together
from automarine_cli.workflows.check import check
from automarine_cli.workflows.command import Command, Runner, inputs_of, recorded, seed_of
from automarine_cli.workflows.diagnose import diagnose
from automarine_cli.workflows.diagnose_planar import diagnose_planar
from automarine_cli.workflows.fit_planar import fit_planar
from automarine_cli.workflows.fit_thrusters import fit_thrusters
from automarine_cli.workflows.fit_yaw import FITS
from automarine_cli.workflows.tune import tune
from automarine_cli.workflows.validate import validate
from automarine_cli.workflows.validate_planar import validate_planar

FIGURES = ("png", "svg")  # for a person, and for the report
RUNS = {"steps": "step runs", "manoeuvres": "manoeuvres", "validation": "validation runs"}


Work = Command[Any, Any]


@dataclass(frozen=True)
class Plan:
    """One step, ready to run: the command and its options."""

    work: Work
    asked: Record

    def run(self, out: Path, overwrite: bool, jobs: int, progress: Progress) -> object:
        """Run it into the folder `out`."""
        return self.work.run(self.asked, Runner(self.work.name, out, overwrite, jobs, None, progress))

    def why(self, folder: Path) -> str | None:
        """Why the result in `folder` is not the one that this plan makes, or None if it is."""
        return why_made_again(
            folder, command=self.work.name, options=recorded(self.asked), seed=seed_of(self.asked),
            inputs=inputs_of(self.asked),
        )  # fmt: skip


def _plan(work: Work, logs: list[LogFile], **settings: object) -> Plan:
    return Plan(work, work.asked({"logs": logs, **settings}))


@dataclass(frozen=True)
class Step:
    """A step of every campaign, or of those with logs of `motion` or another section of that name: its name, its
    folder, the command, and what makes its plan (or says why there is none)."""

    name: str
    folder: str
    work: Work
    plan: Callable[[Campaign, Path], Plan | str]
    motion: str = ""

    @property
    def command(self) -> str:
        """The command that it runs."""
        return self.work.name

    def belongs_to(self, campaign: Campaign) -> bool:
        """Whether the campaign has such a step."""
        return not self.motion or getattr(campaign.asked, self.motion) is not None


def _check(campaign: Campaign, out: Path) -> Plan | str:
    return _plan(check, campaign.every_log(), columns=campaign.columns, strict=campaign.asked.strict)


def _fit_thrusters(campaign: Campaign, out: Path) -> Plan | str:
    logs, asked = campaign.files("thrusters"), campaign.asked.thrusters
    if not logs:
        return "the campaign names no thruster tests"
    form = None if asked.form == "auto" else asked.form
    return _plan(fit_thrusters, logs, thrusters_per_test=asked.per_test, form=form, **_common(campaign))


def _fit(campaign: Campaign, out: Path, motion: str) -> Plan | str:
    logs = campaign.files("steps", motion=motion) or campaign.files("manoeuvres", motion=motion)
    if not logs:
        return _none_named(("steps", "manoeuvres"), motion)
    drive = _drive(campaign, out, motion)
    if drive is None:
        return f"its {DOFS[motion].words.force}s need the thruster map, and fit-thrusters gave none"
    asked = campaign.settings(motion)
    assert not isinstance(asked, Together)
    own = {key: getattr(asked, key) for key in ("within", "depths") if hasattr(asked, key)}
    own |= {"fit_to": asked.fit_to, "tail": asked.tail, "channels": asked.channels, "known": asked.known}
    return _plan(FITS[motion], logs, **_common(campaign), **drive, **own)


def _judge(campaign: Campaign, out: Path, motion: str, work: Work) -> Plan | str:
    """Validation or diagnosis."""
    kinds = ("validation",) if work is validate else ("steps", "manoeuvres")
    logs, held = campaign.files(*kinds, motion=motion), campaign.files("validation", motion=motion)
    if not logs:
        return _none_named(kinds, motion)
    model, drive = out / motion / f"{motion}_model.json", _drive(campaign, out, motion)
    if not model.is_file() or drive is None:
        return f"it needs the {motion} model, and fit-{motion} gave none"
    more: dict[str, object] = {"hold_out": held} if work is diagnose else {}
    asked = campaign.settings(motion)
    assert not isinstance(asked, Together)
    more |= {"model": model, "seed": campaign.asked.seed, "channels": asked.channels}
    return _plan(work, logs, **_common(campaign), **drive, **more)


def _together(campaign: Campaign, out: Path, work: Work) -> Plan | str:
    """Fit, validation or diagnosis of surge, sway and yaw together."""
    motion = PLANAR.name
    runs, held = (campaign.files(kind, motion=motion) for kind in ("runs", "validation"))
    logs = held if work is validate_planar else runs
    if not logs:
        return f"the campaign names no {'validation runs' if work is validate_planar else 'runs'} of {motion} motion"
    drive = _drive(campaign, out, motion)
    if drive is None:
        return "its forces need the thruster map, and fit-thrusters gave none"
    settings = {**_common(campaign), **drive}
    if work is fit_planar:
        assert campaign.asked.planar is not None
        return _plan(work, logs, **settings, known=campaign.asked.planar.known)
    settings["model"] = out / motion / "planar_model.json"
    if not (out / motion / "planar_model.json").is_file():
        return "it needs the planar model, and fit-planar gave none"
    if work is diagnose_planar:
        settings |= {"seed": campaign.asked.seed, "hold_out": held}
    return _plan(work, logs, **settings)


def _tune(campaign: Campaign, out: Path) -> Plan | str:
    """Gains for what the diagnosis of yaw left behind, or for the model where there is none."""
    places = (out / "diagnosis" / DIAGNOSIS.file, out / YAW.name / MODELS[YAW.name].file)
    model = next((place for place in places if place.is_file()), None)
    if model is None or campaign.asked.tune is None:
        return "it needs the yaw model, and fit-yaw gave none"
    settings = {key: one for key, one in vars(campaign.asked.tune).items() if key != "thrusters"}
    if campaign.asked.tune.thrusters:
        drive = _map(campaign, out)
        if drive is None:
            return "it needs the thruster map, and fit-thrusters gave none"
        settings |= {"thrusters": drive, "arm": campaign.asked.vehicle.arm_m}
    if campaign.asked.tune.present is not None:
        settings = {**settings, "present": campaign.path.parent / campaign.asked.tune.present}
    own = {"figure_formats": FIGURES, "seed": campaign.asked.seed}
    return Plan(tune, tune.asked({"model": model, **settings, **own}))


def _none_named(kinds: tuple[str, ...], motion: str) -> str:
    of_motion = "" if motion == YAW.name else f" of {motion}"
    return f"the campaign names no {' and no '.join(RUNS[kind] for kind in kinds)}{of_motion}"


def _common(campaign: Campaign) -> dict[str, object]:
    return {"columns": campaign.columns, "figure_formats": FIGURES, "strict": campaign.asked.strict}


def _drive(campaign: Campaign, out: Path, motion: str) -> dict[str, object] | None:
    """The settings that make moments or forces of thruster commands; none where they are logged, None without a map."""
    if campaign.settings(motion).logged:
        return {}
    thrusters = _map(campaign, out)
    if thrusters is None:
        return None
    levered = motion == PLANAR.name or DOFS[motion].levered
    arm = {"arm": campaign.asked.vehicle.arm_m} if levered else {}
    return {"thrusters": thrusters, **arm}


def _map(campaign: Campaign, out: Path) -> Path | None:
    """The thruster map that is at hand."""
    fitted = out / "thrusters" / "thrusters.json"
    return campaign.map or (fitted if fitted.is_file() else None)


def _of(motion: str) -> Iterator[Step]:
    """The steps of one motion: every campaign has those of yaw, others those of which they have logs."""
    yaw = motion == YAW.name
    after, before, only = ("", "", "") if yaw else (f"-{motion}", f"{motion}_", motion)
    yield Step(f"fit-{motion}", motion, FITS[motion], partial(_fit, motion=motion), only)
    for work, folder in ((validate, "validation"), (diagnose, "diagnosis")):
        plan = partial(_judge, motion=motion, work=work)
        yield Step(f"{work.name}{after}", before + folder, work, plan, only)


def _of_plane() -> Iterator[Step]:
    """The steps of surge, sway and yaw together."""
    name = PLANAR.name
    works = ((fit_planar, ""), (validate_planar, "_validation"), (diagnose_planar, "_diagnosis"))
    for work, folder in works:
        step = work.name if work is fit_planar else f"{work.name}-{name}"
        yield Step(step, f"{name}{folder}", work, partial(_together, work=work), name)


STEPS = (
    Step("check", "check", check, _check),
    Step("fit-thrusters", "thrusters", fit_thrusters, _fit_thrusters),
    *(step for motion in DOFS for step in _of(motion)),
    *_of_plane(),
    Step("tune", "tune", tune, _tune, "tune"),
)
FOLDERS = tuple(
    StepFolder(step.folder, step.name, step.work.kept.kind, not step.motion)
    for step in STEPS
    if step.work.kept is not None
)
"""What a report is made from."""
REPORT = "report"
NAMES = (*(step.name for step in STEPS), REPORT)
