"""A simulated vehicle with the dynamics of a model file."""

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.link.document import LinkCampaign, PlannedRun
from automarine_cli.link.vehicles.base import Halted, Pace, refuse_beyond
from automarine_cli.models.model import Model
from automarine_cli.models.store import file_and_models
from automarine_cli.pipeline.parallel import Progress, silent
from automarine_cli.pipeline.records import read_plain
from automarine_cli.planning.candidates import MOMENT_COLUMNS
from automarine_cli.planning.information import PlannedLog
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate, step_for
from automarine_cli.simulation.specification import normal
from automarine_cli.text import listed, printable

COMPASS_NOISE_DEG = 1.0  # of the simulated compass, as the paper's


@dataclass(frozen=True)
class Simulated:
    model: Model
    speed: float = 1.0
    full: float = 1.0

    @classmethod
    def of(cls, path: Path, speed: float, full: float | None = None) -> "Simulated":
        """Read the preferred model; it takes moments up to `full` in its unit (None: up to those fitted, and 1 nu).
        Raises ModelError, and SettingError where nothing says how large moments may be."""
        file, stored = file_and_models(read_plain(path, "JSON", ModelError), printable(path.name))
        if stored.dof is not YAW:
            raise ModelError(f"{stored.source} is a model of {stored.dof.name}; give a yaw model to the vehicle")
        if full is None:
            normalised = (1.0,) if stored.model.moment_unit == "nu" else ()
            full = max((abs(end) for end in (*(file.force_range or ()), *normalised)), default=None)
        if full is None:
            unknown = f"how large moments in {stored.model.moment_unit} may be"
            raise SettingError(f"{stored.source} does not say {unknown}; give --full")
        return cls(stored.models[stored.preferred], speed, full)

    def refuse(self, campaign: LinkCampaign) -> None:
        """Raise SettingError for moments of another unit or too large ones, and a model of more than moments."""
        if needed := self.model.signals:
            remedy = "which a simulated vehicle does not log; choose a model without it"
            raise SettingError(f"the vehicle's model needs {listed(needed)}, {remedy}")
        if campaign.moment_unit != (unit := self.model.moment_unit):
            mismatch = f"the campaign's moments are in {campaign.moment_unit}, the vehicle's model is in {unit}"
            raise SettingError(f"{mismatch}; make the plan from the vehicle's model")
        refuse_beyond(campaign, self.full)

    def track(self, campaign: LinkCampaign, run: PlannedRun) -> tuple[Floats, Floats, Floats]:
        """How the vehicle would turn, without noise: time [s since the start], heading [rad] and moment, (N,) each."""
        logger = PlannedLog(YAW, campaign.moment_unit, campaign.rate_hz, campaign.rest_s, None, None)
        on_paper = logger.run(run.candidate)
        step = step_for(self.model, float(np.max(np.abs(on_paper.command))))
        start = Start(position=np.deg2rad([[run.start_heading_deg]]))
        simulated = simulate(self.model, make_batch([on_paper], step), start=start)
        return on_paper.time, simulated.position[0, 0], on_paper.command

    def drive(self, campaign: LinkCampaign, number: int, halted: Halted) -> Generator[str, None, None]:
        """The lines of a run's log: time on the campaign's clock, heading and the moment as commanded."""
        run, begins = campaign.runs[number], campaign.begins(number)
        name = campaign.log_name(run)
        time, heading, moments = self.track(campaign, run)
        readings = np.round(np.rad2deg(heading) + COMPASS_NOISE_DEG * normal(len(time), 0, name), 3) % 360.0
        if halted():
            return
        yield f"# Driven by a simulated vehicle, {name}: no measurement.\n"
        yield f"time_s,heading_deg,{MOMENT_COLUMNS[campaign.moment_unit]}\n"
        pace = Pace(self.speed)
        for since, reading, moment in zip(time, readings, moments):
            pace.until(float(since))
            ends = since > 0 and halted()
            yield f"{begins + since:.3f},{reading:.3f},{0.0 if ends else moment:g}\n"
            if ends:
                return


@dataclass(frozen=True)
class Rehearsal:
    """What a campaign would be, run by run: `name`, `begins_s` of its log, `driven_s`, `turned_deg` of the simulated
    vehicle (None without a model), and `left_Ah` of the battery."""

    campaign: LinkCampaign
    planned: tuple[dict[str, Any], ...]

    def to_json(self) -> dict[str, Any]:
        return {"schema": "automarine/rehearsal/1", "campaign": self.campaign.id, "planned": [*self.planned]}


def rehearse(campaign: LinkCampaign, vehicle: Simulated | None, progress: Progress = silent) -> Rehearsal:
    """Say what a campaign would be. Raises SettingError for one that the simulated vehicle cannot drive."""
    if vehicle is not None:
        vehicle.refuse(campaign)
    runs, turned = [], None
    for number, run in enumerate(campaign.runs):
        if vehicle is not None:
            _, heading, _ = vehicle.track(campaign, run)
            turned = float(np.rad2deg(heading[-1] - heading[0]))
        runs.append({
            "name": run.name, "begins_s": campaign.begins(number), "driven_s": run.driven_s, "turned_deg": turned,
            "left_Ah": campaign.charge(number + 1),
        })  # fmt: skip
        progress("simulating", number + 1, len(campaign.runs))
    return Rehearsal(campaign, tuple(runs))
