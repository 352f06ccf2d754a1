"""`diagnose`: where simulation and measurement disagree, which effect is missing, and the gap that it closes."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from automarine_cli.commands import options
from automarine_cli.commands.command import command
from automarine_cli.errors import RunError, SettingError

if TYPE_CHECKING:
    from automarine_cli.diagnosis.diagnose import Diagnosis
    from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis
    from automarine_cli.pipeline.parallel import Progress


@command("diagnose", report="diagnosis_report", by_effects=True)
@options.logs
@options.model
@options.hold_out
@options.columns
@options.thrusters
@options.arm
@options.channels
@options.ending(options.strict, options.seed, options.jobs, options.cluster)
def diagnose(
    logs: Sequence[Any], model: Any, hold_out: Sequence[Any], columns: Any, thrusters: Any, arm: float | None,
    channels: str, strict: bool, seed: int, jobs: int, map_fn: Any, progress: Any,
) -> "Diagnosis | ThrusterDiagnosis":  # fmt: skip
    """Find where simulation and measurement disagree, and name the effect that the model lacks.

    Each effect of the library is added to the model in turn, and everything is fitted again to whole runs. The
    verdict is one of four: named (with the rivals that the runs cannot exclude), suspected, nothing missing, or
    unexplained. A named effect gains more than chance would, and held-out runs confirm it. Where no effect explains
    the error, a curve over one variable or logged column is learned. With a thrusters.json as the model, bollard
    tests are diagnosed in the same way.

    \b
    Example:
      automarine fit-yaw sample_runs/hidden_one --fit-to whole-runs \\
        -o out/hidden_one
      automarine diagnose sample_runs/hidden_one \\
        --model out/hidden_one/yaw_model.json -o out/diagnose_one
    """
    from automarine_cli.logs import given_columns
    from automarine_cli.models.store import PLANAR_MODEL
    from automarine_cli.pipeline.records import schema_in
    from automarine_cli.thrusters.map import THRUSTER_MAP

    names, schema = given_columns(columns), schema_in(model)
    execution: dict[str, Any] = {"strict": strict, "progress": progress}
    if schema == THRUSTER_MAP.schema:
        return _of_a_map(logs, model, hold_out, names, seed, **execution)
    drive = {"columns": names, "thrusters": thrusters, "arm": arm, "jobs": jobs} | execution
    if schema == PLANAR_MODEL.schema:
        return _of_the_plane(logs, model, hold_out, seed, drive)
    return _of_a_motion(logs, model, hold_out, channels, seed, map_fn, drive)


def _of_a_motion(
    logs: Sequence[Any], model: Any, hold_out: Sequence[Any], channels: str, seed: int, map_fn: Any,
    drive: Mapping[str, Any],
) -> "Diagnosis":  # fmt: skip
    """Diagnose the preferred model of one motion; without `hold_out` a quarter of the runs is held out."""
    from automarine_cli.comparison.validation import load_usable
    from automarine_cli.diagnosis.diagnose import diagnose_runs
    from automarine_cli.models.store import read_model
    from automarine_cli.pipeline.results_folder import sha256
    from automarine_cli.runs.channels import parse_channels
    from automarine_cli.runs.checks import without_stuck
    from automarine_cli.runs.half_turn import without_contrary
    from automarine_cli.runs.load import append_exclusions, require_usable
    from automarine_cli.runs.run import ExcludedRun, Run

    stored = read_model(model)
    parse_channels(channels, stored.dof)
    aside: list[ExcludedRun] = []

    def usable(files: Sequence[Any]) -> list[Run]:
        campaign = load_usable(files, stored, **drive)
        moving, stuck = without_stuck(campaign.runs)
        sound, contrary = without_contrary(moving)
        aside.extend((*campaign.set_aside, *stuck, *contrary))
        require_usable(sound, aside, len(files), drive["strict"])
        return sound

    runs, held_out = usable(logs), usable(hold_out) if hold_out else None
    with append_exclusions(aside):
        diagnosis = diagnose_runs(
            runs, stored.undelayed, hold_out=held_out, seed=seed, map_fn=map_fn, channels=channels,
            number=stored.preferred, driven=bool(stored.random),
            goes_on=partial(foretell, drive["progress"], time.monotonic()),
        )  # fmt: skip
    return replace(diagnosis, parent={"file": stored.source, "sha256": sha256(model)}, set_aside=tuple(aside))


FIRST_LOOKS = 3.3  # that a search takes: 1.5 to 3 where one effect is missing, 7 where two are


def foretell(progress: "Progress", begun: float) -> None:
    """Say how long a diagnosis that began at this time [s] will take, from how long its first look took."""
    seconds = FIRST_LOOKS * (time.monotonic() - begun)
    if seconds >= 60.0:
        progress(f"the diagnosis takes about {round(seconds / 60.0)} min", 0, 0)


def _of_the_plane(
    logs: Sequence[Any], model: Any, hold_out: Sequence[Any], seed: int, settings: Mapping[str, Any]
) -> "Diagnosis":
    """Diagnose a planar model; its runs are few and long, so that one in four is held out of four or more."""
    from automarine_cli.diagnosis.diagnose import split_off
    from automarine_cli.diagnosis.planar import MIN_TO_SPLIT, diagnose_planar
    from automarine_cli.fits.planar_structure import observed
    from automarine_cli.models.store import read_model
    from automarine_cli.pipeline.results_folder import sha256
    from automarine_cli.thrusters.map import load_planar

    stored = read_model(model)
    campaign, other = load_planar(logs, **settings), load_planar(hold_out, **settings) if hold_out else None
    runs, held_out = (campaign.runs, other.runs) if other else split_off(campaign.runs, seed, MIN_TO_SPLIT)
    if not held_out:
        raise SettingError(f"no run is held out: expected at least {MIN_TO_SPLIT} logs, or some given with --hold-out")
    goes_on = partial(foretell, settings["progress"], time.monotonic())
    diagnosis = diagnose_planar(stored, runs, held_out, observed(campaign.runs), seed, goes_on)
    aside = (*campaign.set_aside, *(other.set_aside if other else ()))
    return replace(diagnosis, parent=sha256(model), set_aside=aside)


def _of_a_map(
    logs: Sequence[Any], model: Any, hold_out: Sequence[Any], names: Any, seed: int, *, strict: bool, progress: Any
) -> "ThrusterDiagnosis":
    """Diagnose a thruster map on bollard tests; without `hold_out` a quarter of the levels is held out."""
    from automarine_cli.diagnosis.thruster_map import diagnose_thrusters
    from automarine_cli.thrusters.bollard_data import load_thruster_logs, thrusters_pulling
    from automarine_cli.thrusters.map import THRUSTER_MAP, ThrusterMap

    base, file = ThrusterMap.load(model), THRUSTER_MAP.read(model)
    apart = {log.path.resolve() for log in hold_out}
    if not (fitted := [log for log in logs if log.path.resolve() not in apart]):
        raise RunError("every log is held out; give at least one that is not named with --hold-out")
    loaded = load_thruster_logs(fitted, names, strict=strict, progress=progress)
    held_out = load_thruster_logs(hold_out, names, strict=strict, progress=progress) if hold_out else None
    progress("diagnosing", 0, 1)
    result = diagnose_thrusters(
        loaded, base, hold_out=held_out, thrusters=thrusters_pulling(None, names, max(file.thrusters_per_test or 1, 1)),
        n_unit=loaded.n_unit, voltage="reference_V" in file.voltage_exponent, seed=seed,
    )  # fmt: skip
    progress("diagnosing", 1, 1)
    return result


def _refuse_of_another(settings: dict[str, Any]) -> dict[str, Any]:
    from automarine_cli.models.store import PLANAR_MODEL
    from automarine_cli.pipeline.records import schema_in
    from automarine_cli.runs.channels import AUTO
    from automarine_cli.thrusters.map import THRUSTER_MAP

    name, schema = settings["model"].name, schema_in(settings["model"])
    if schema == THRUSTER_MAP.schema and (settings["thrusters"] is not None or settings["arm"] is not None):
        raise SettingError(f"{name} is a thruster map: --thrusters and --arm belong to a yaw model; leave them out")
    if schema == THRUSTER_MAP.schema and settings["channels"] != AUTO:
        raise SettingError(f"{name} is a thruster map: --channels belongs to a motion; leave it out")
    if schema == PLANAR_MODEL.schema and settings["channels"] != AUTO:
        raise SettingError(f"{name} is a planar model: every channel counts; leave --channels out")
    return settings


def _then(result: Any) -> str:
    from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis

    if isinstance(result, ThrusterDiagnosis):
        return "automarine fit-yaw LOGS --thrusters {out}/extended_model.json --arm METRES"
    return "automarine validate OTHER_LOGS --model {out}/extended_model.json"


diagnose.complete, diagnose.then = _refuse_of_another, _then
