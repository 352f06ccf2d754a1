"""`plan`: what is still unsure and what a day at the pool allows -> the runs of the next campaign."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automarine_cli.fits.estimate import Estimate
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import ResultFolder, result_folder
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.recipe import to_mapping, toml_text
from automarine_cli.pipeline.shown import Shown
from automarine_cli.planning.campaign import Campaign, plan_campaign, specification
from automarine_cli.planning.candidates import Slot
from automarine_cli.planning.limits import EXAMPLE, Limits, read_limits
from automarine_cli.planning.prior_results import read_prior_results
from automarine_cli.planning.rivals import Split
from automarine_cli.planning.vehicle import Drive, command_file
from automarine_cli.report import plan_page, plan_tables
from automarine_cli.report.figures.files import refuse_unknown, write_figures
from automarine_cli.report.figures.plan import plan_figure
from automarine_cli.report.tables import Table
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.records import load_thruster_logs
from automarine_cli.workflows.plan_vehicle import drive_for, largest_moment, supply_for

SCHEMA = "automarine/plan/1"
FILES = ("plan.md", "plan.csv", "plan.json", "plan.toml", "plan.png", "commands/")


@dataclass(frozen=True, repr=False)
class Plan(Shown):
    """A campaign on paper, the name of the model's file, the drive (or None), and where the current is from."""

    campaign: Campaign
    model: str
    drive: Drive | None
    source: str
    seed: int

    def to_json(self) -> dict[str, Any]:
        """The result: schema automarine/plan/1."""
        made, limits = self.campaign, self.campaign.limits
        return {
            "schema": SCHEMA,
            "model": self.model,
            "moment_unit": made.fitting.model.moment_unit,
            "fit": made.fitting.fit,
            "fit_command": plan_page.fit_command(made, self.model),
            "planned_for": list(made.wanted) or list(made.alone),
            "heading_noise_rad": made.fitting.noise,
            **({} if made.fitting.rate_noise is None else {"rate_noise_rad_s": made.fitting.rate_noise}),
            "gain_scatter": made.fitting.scatter,
            "limits": to_mapping(limits),
            "totals": {
                "runs": len(made.slots),
                "pool_min": made.slots[-1].ends(limits.runs.rest_before_s) / 60.0,
                "motion_s": made.motion,
                "battery_left_Ah": made.slots[-1].left,
                "battery_left_percent": 100.0 * made.slots[-1].left / limits.battery.charge_Ah,
            },
            "planned": [_slot_json(slot, why) for slot, why in zip(made.slots, made.why)],
            "parameters": {
                name: {
                    "now": _json(made.now.get(name)), "new_runs": one.to_json(),
                    "with_earlier_runs": _json(made.together.get(name)),
                }
                for name, one in made.alone.items()
            },
            "splits": [_split_json(one, grid) for one, grid in zip(made.splits, made.grid_splits)],
            "curves": [
                {
                    "campaign": curve.name, "minutes": list(curve.minutes), "motion_s": list(curve.motion),
                    "stderr_percent": {name: list(values) for name, values in curve.percent.items()},
                }
                for curve in (made.plan, made.grid, *made.more)
            ],
            "notes": [self.source, *made.notes],
        }  # fmt: skip

    def tables(self) -> list[Table | str]:
        """What the terminal shows."""
        fit = f"Planned for: {plan_page.fit_command(self.campaign, self.model)}"
        return [
            *plan_tables.total_sentences(self.campaign),
            fit,
            *self.campaign.notes,
            *plan_tables.tables(self.campaign),
        ]


def example_limits() -> str:
    """A limits file with every setting, its default and what it means."""
    return EXAMPLE


def plan(
    model: Path,
    *,
    diagnosis: Path | None = None,
    limits: Path | Limits | None = None,
    parameters: tuple[str, ...] = (),
    thrusters: Path | ThrusterMap | None = None,
    arm: float | None = None,
    thruster_tests: Sequence[str | Path] = (),
    columns: Path | ColumnMap | None = None,
    out: Path | None = None,
    figure_formats: tuple[str, ...] = ("png",),
    overwrite: bool = False,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress = silent,
) -> Plan:
    """Plan the next campaign for the preferred model of the file `model`, and for the rivals in a `diagnosis`.

    `parameters` are those whose intervals are to shrink (all by default); `limits` say what the pool day allows;
    `thrusters` and `arm` [m] make control signals of moments, and with `thruster_tests` that logged a current or a
    power the battery's use. `seed` draws the order of the runs; the work takes seconds, so `jobs` changes nothing.
    Writes the results if `out` is given. Raises ModelError, SettingError, LogError, RunError or OutputError.
    """
    refuse_unknown(figure_formats)
    known = read_prior_results(model, diagnosis)
    allowed = limits if isinstance(limits, Limits) else Limits() if limits is None else read_limits(limits)
    column_map = given_columns(columns)
    drive = drive_for(thrusters, arm, column_map, known, allowed)
    largest = largest_moment(known, allowed, drive)
    tests = load_thruster_logs(thruster_tests, column_map, progress=progress) if thruster_tests else None
    records = None if tests is None else tests.records
    per_test = int(column_map.defaults.get("thrusters_per_test", 1))
    supply, source = supply_for(allowed, largest, known.stored.moment_unit, drive, per_test, records)

    def work() -> Plan:
        found = plan_campaign(
            known, allowed, largest, supply, wanted=tuple(parameters), seed=seed, progress=progress
        )
        return Plan(found, known.stored.source, drive, source, seed)

    if out is None:
        return work()
    inputs = given_as(model=model, diagnosis=diagnosis, limits=limits, thrusters=thrusters, columns=columns)
    inputs += [
        Input(file.name, file.path, "thruster_tests") for file in (() if tests is None else tests.inputs)
    ]
    options: Mapping[str, object] = {
        "model": model,
        "diagnosis": diagnosis,
        "limits": limits,
        "parameters": tuple(parameters),
        "thrusters": thrusters,
        "arm": arm,
        "columns": columns,
        "figure_formats": figure_formats,
    }
    with result_folder(
        out, command="plan", options=options, inputs=inputs, seed=seed, overwrite=overwrite
    ) as folder:
        result = work()
        _write(folder, result, figure_formats)
    return result


def _write(folder: ResultFolder, result: Plan, formats: tuple[str, ...]) -> None:
    made = result.campaign
    spec, missing = specification(made, result.seed)
    rehearsal = missing
    if spec:
        rehearsal = f"Rehearse it with `automarine simulate plan.toml -o out/rehearsal`. {missing}".rstrip()
        folder.write("plan.toml", toml_text(spec))
    folder.write("plan.md", plan_page.page(made, result.model, result.source, rehearsal))
    folder.write("plan.csv", plan_tables.sheet_csv(made))
    folder.write_json("plan.json", result.to_json())
    unit, rest = made.fitting.model.moment_unit, made.limits.runs.rest_before_s
    for slot in made.slots:
        content = command_file(slot.candidate, rest, unit, result.drive)
        folder.write(plan_tables.command_name(slot.name), content)
    write_figures(folder, {"plan": lambda: plan_figure(made)}, formats)


def _slot_json(slot: Slot, why: str) -> dict[str, Any]:
    one = slot.candidate
    return {
        "number": slot.number,
        "name": slot.name,
        "kind": one.kind,
        "begins_s": slot.begins,
        "start_heading_deg": one.start_heading,
        "voltage_V": one.voltage,
        "commands": [[moment, seconds] for moment, seconds in one.commands],
        "wait_s": slot.wait,
        "battery_left_Ah": slot.left,
        "command_file": plan_tables.command_name(slot.name),
        "why": why,
    }


def _split_json(one: Split, grid: Split) -> dict[str, Any]:
    return {"true": one.true, "other": one.other, "evidence": one.evidence, "evidence_of_grid": grid.evidence}


def _json(one: Estimate | None) -> dict[str, object] | None:
    return None if one is None else one.to_json()
