"""The steps of a campaign in order: which logs and settings each takes, or why it has nothing to do."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from automarine_cli.dofs import DOFS, YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.logs import ColumnMap, LogFile
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.reuse import manifest_of, why_made_again
from automarine_cli.runs.channels import asked_channels
from automarine_cli.runs.load import has_bytes
from automarine_cli.workflows.campaign_file import Campaign
from automarine_cli.workflows.check import check
from automarine_cli.workflows.diagnose import diagnose
from automarine_cli.workflows.diagnose_planar import diagnose_planar
from automarine_cli.workflows.fit_planar import fit_planar
from automarine_cli.workflows.fit_thrusters import fit_thrusters
from automarine_cli.workflows.fit_yaw import FITS
from automarine_cli.workflows.validate import validate
from automarine_cli.workflows.validate_planar import validate_planar

FIGURES = ("png", "svg")  # for a person, and for the report
RUNS = {"steps": "step runs", "manoeuvres": "manoeuvres", "validation": "validation runs"}


@dataclass(frozen=True)
class Plan:
    """One step, ready to run: the workflow, its logs and its settings."""

    work: Callable[..., object]
    logs: list[LogFile]
    settings: Mapping[str, Any] = field(default_factory=dict)

    def run(self, **how: Any) -> object:
        """Run the workflow; `how` is where to and on how many processes."""
        return self.work(self.logs, **self.settings, **how)

    def why(self, folder: Path, command: str) -> str | None:
        """Why the result in `folder` is not the one that this plan makes, or None if it is."""
        defaults = {key: one.default for key, one in inspect.signature(self.work).parameters.items()}
        held = self.settings.get("hold_out", ())
        given = {**self.settings, "hold_out": [file.name for file in held]} if held else self.settings
        manifest = manifest_of(folder)
        recorded = manifest.options if manifest is not None else {}
        options = {key: given.get(key, _default(defaults.get(key))) for key in {**recorded, **given}}
        options.pop("seed", None)
        inputs = [Input(file.name, file.path) for file in self.logs if has_bytes(file)]
        inputs += [Input(file.name, file.path, "hold_out") for file in held if has_bytes(file)]
        files = {key: value for key, value in self.settings.items() if isinstance(value, Path)}
        if isinstance(columns := self.settings.get("columns"), ColumnMap) and columns.database is not None:
            files["dbc"] = columns.database
        seed = self.settings.get("seed", defaults.get("seed"))
        return why_made_again(
            folder, command=command, options=options, seed=seed, inputs=inputs + given_as(**files)
        )


def _default(value: object) -> object:
    return [] if value == () else value


@dataclass(frozen=True)
class Step:
    """A step of every campaign, or of those with logs of `motion`: its name, its folder, what makes its plan (or says
    why there is none), and the command, by default of the step's name."""

    name: str
    folder: str
    plan: Callable[[Campaign, Path], Plan | str]
    motion: str = ""
    does: str = ""

    @property
    def command(self) -> str:
        """The command that it runs."""
        return self.does or self.name

    def belongs_to(self, campaign: Campaign) -> bool:
        """Whether the campaign has such a step."""
        return not self.motion or self.motion in campaign.motions


def _check(campaign: Campaign, out: Path) -> Plan | str:
    return Plan(check, campaign.every_log(), {"columns": campaign.columns, "strict": campaign.asked.strict})


def _fit_thrusters(campaign: Campaign, out: Path) -> Plan | str:
    logs, asked = campaign.files("thrusters"), campaign.asked.thrusters
    if not logs:
        return "the campaign names no thruster tests"
    form = None if asked.form == "auto" else asked.form
    return Plan(
        fit_thrusters,
        logs,
        {
            "columns": campaign.columns,
            "thrusters_per_test": asked.per_test,
            "form": form,
            "figure_formats": FIGURES,
            "strict": campaign.asked.strict,
        },
    )


def _fit(campaign: Campaign, out: Path, motion: str) -> Plan | str:
    logs = campaign.files("steps", motion=motion) or campaign.files("manoeuvres", motion=motion)
    if not logs:
        return _none_named(("steps", "manoeuvres"), motion)
    drive = _drive(campaign, out, motion)
    if drive is None:
        return f"its {DOFS[motion].words.force}s need the thruster map, and fit-thrusters gave none"
    asked: Any = campaign.settings(motion)
    own = {key: getattr(asked, key) for key in ("within", "depths") if hasattr(asked, key)}
    own |= {"fit_to": asked.fit_to, "tail": asked.tail, **asked_channels(asked.channels)}
    return Plan(FITS[motion], logs, {**_common(campaign), **drive, **own})


def _judge(campaign: Campaign, out: Path, motion: str, work: Callable[..., object]) -> Plan | str:
    """Validation or diagnosis."""
    kinds = ("validation",) if work is validate else ("steps", "manoeuvres")
    logs, held = campaign.files(*kinds, motion=motion), campaign.files("validation", motion=motion)
    if not logs:
        return _none_named(kinds, motion)
    model, drive = out / motion / f"{motion}_model.json", _drive(campaign, out, motion)
    if not model.is_file() or drive is None:
        return f"it needs the {motion} model, and fit-{motion} gave none"
    more: dict[str, object] = {"hold_out": held} if held and work is diagnose else {}
    asked: Any = campaign.settings(motion)
    more |= asked_channels(asked.channels)
    return Plan(
        work, logs, {**_common(campaign), **drive, "model": model, "seed": campaign.asked.seed, **more}
    )


def _together(campaign: Campaign, out: Path, work: Callable[..., object]) -> Plan | str:
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
        return Plan(work, logs, settings)
    settings["model"] = out / motion / "planar_model.json"
    if not (out / motion / "planar_model.json").is_file():
        return "it needs the planar model, and fit-planar gave none"
    if work is diagnose_planar:
        settings |= {"seed": campaign.asked.seed, **({"hold_out": held} if held else {})}
    return Plan(work, logs, settings)


def _none_named(kinds: tuple[str, ...], motion: str) -> str:
    of_motion = "" if motion == YAW.name else f" of {motion}"
    return f"the campaign names no {' and no '.join(RUNS[kind] for kind in kinds)}{of_motion}"


def _common(campaign: Campaign) -> dict[str, object]:
    return {"columns": campaign.columns, "figure_formats": FIGURES, "strict": campaign.asked.strict}


def _drive(campaign: Campaign, out: Path, motion: str) -> dict[str, object] | None:
    """The settings that make moments or forces of thruster commands; none where they are logged, None without a map."""
    if campaign.settings(motion).logged:
        return {}
    thrusters = campaign.map or out / "thrusters" / "thrusters.json"
    if campaign.map is None and not thrusters.is_file():
        return None
    levered = motion == PLANAR.name or DOFS[motion].levered
    arm = {"arm": campaign.asked.vehicle.arm_m} if levered else {}
    return {"thrusters": thrusters, **arm}


def _of(motion: str) -> tuple[Step, ...]:
    """The steps of one motion: every campaign has those of yaw, others those of which they have logs."""
    yaw = motion == YAW.name
    after, before, only = ("", "", "") if yaw else (f"-{motion}", f"{motion}_", motion)
    judged = (("validate", "validation", validate), ("diagnose", "diagnosis", diagnose))
    return (
        Step(f"fit-{motion}", motion, partial(_fit, motion=motion), only),
        *(
            Step(
                f"{command}{after}", before + folder, partial(_judge, motion=motion, work=work), only, command
            )
            for command, folder, work in judged
        ),
    )


STEPS = (
    Step("check", "check", _check),
    Step("fit-thrusters", "thrusters", _fit_thrusters),
    *(step for motion in DOFS for step in _of(motion)),
    Step("fit-planar", "planar", partial(_together, work=fit_planar), PLANAR.name),
    Step(
        "validate-planar",
        "planar_validation",
        partial(_together, work=validate_planar),
        PLANAR.name,
        "validate",
    ),
    Step(
        "diagnose-planar",
        "planar_diagnosis",
        partial(_together, work=diagnose_planar),
        PLANAR.name,
        "diagnose",
    ),
)
REPORT = "report"
NAMES = (*(step.name for step in STEPS), REPORT)
