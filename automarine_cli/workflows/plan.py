"""`plan`: what is still unsure and what a day at the pool allows -> the runs of the next campaign."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from automarine_cli.errors import ModelError
from automarine_cli.logs import Logs, given_columns
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import Source, to_mapping, toml_text
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.planning.campaign import Campaign, plan_campaign, specification
from automarine_cli.planning.candidates import Supply
from automarine_cli.planning.limits import EXAMPLE, Limits, read_limits
from automarine_cli.planning.prior_results import read_prior_results
from automarine_cli.planning.rivals import Split
from automarine_cli.planning.vehicle import Drive, command_file
from automarine_cli.report import plan_page, plan_tables
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.figures.plan import plan_figure
from automarine_cli.report.tables import Table
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.kinds import PLAN
from automarine_cli.results.shown import Shown
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.records import load_thruster_logs
from automarine_cli.workflows.command import Command, Runner, reads
from automarine_cli.workflows.plan_vehicle import drive_for, largest_moment, supply_for
from automarine_cli.workflows.shared import Columns, Drawn, aligned
from automarine_cli.workflows.view import Row, View

FILES = ("plan.md", "plan.csv", PLAN.file, "plan.toml", "plan.png", "commands/")


@dataclass(frozen=True, repr=False)
class Plan(Shown):
    """A campaign on paper, the name of the model's file, the drive (or None), what is drawn, and where that is from."""

    campaign: Campaign
    model: str
    drive: Drive | None
    supply: Supply
    source: str
    seed: int

    def to_json(self) -> dict[str, object]:
        """The result: schema automarine/plan/1."""
        made, limits = self.campaign, self.campaign.limits
        return {
            "schema": PLAN.schema,
            "model": self.model,
            "moment_unit": made.fitting.model.moment_unit,
            "fit": made.fitting.fit,
            "fit_command": plan_page.fit_command(made, self.model),
            "planned_for": list(made.wanted) or list(made.alone),
            "heading_noise_rad": made.fitting.noise,
            **({} if made.fitting.rate_noise is None else {"rate_noise_rad_s": made.fitting.rate_noise}),
            "gain_scatter": made.fitting.scatter,
            "limits": to_mapping(limits),
            "supply": {
                "idle_A": self.supply.idle, "full_A": self.supply.full, "at_moment": self.supply.largest,
            },
            "totals": {
                "runs": len(made.slots),
                "pool_min": made.slots[-1].ends(limits.runs.rest_before_s) / 60.0,
                "motion_s": made.motion,
                "battery_left_Ah": made.slots[-1].left,
                "battery_left_percent": 100.0 * made.slots[-1].left / limits.battery.charge_Ah,
            },
            "planned": [_slot_json(made, place) for place in range(len(made.slots))],
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


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """What is planned for, what the pool day allows, and with which thrusters."""

    model: Source = field(metadata=reads("file"))
    diagnosis: Source | None = field(default=None, metadata=reads("file"))
    limits: Path | Limits | None = field(default=None, metadata=reads("file"))
    parameters: tuple[str, ...] = ()
    thrusters: Source | ThrusterMap | None = field(default=None, metadata=reads("file"))
    arm: float | None = None


@dataclass(frozen=True, kw_only=True)
class PlanOptions(Drawn, Columns, _Asked):
    """The model and the rivals of a `diagnosis`; `parameters` are those whose intervals are to shrink (all by default);
    `seed` draws the order of the runs."""

    thruster_tests: Logs = field(default=(), metadata=reads("logs", "thruster_tests"))
    seed: int = 0


def _plan(asked: PlanOptions, runner: Runner) -> Plan:
    """Plan the next campaign for the preferred model of the file `model`, and for the rivals in a `diagnosis`.

    `limits` say what the pool day allows; `thrusters` and `arm` [m] make control signals of moments, and with
    `thruster_tests` that logged a current or a power the battery's use. Raises ModelError, SettingError, LogError,
    RunError or OutputError.
    """
    work = planning(asked, runner.progress)

    def write(folder: ResultFolder, result: Plan) -> None:
        write_plan(folder, result, asked)

    return runner.results(asked, work, write)


def planning(asked: PlanOptions, progress: Progress = silent) -> Callable[[], Plan]:
    """What makes the plan, once everything is read and checked. Raises as `plan` does."""
    known, limits = read_prior_results(asked.model, asked.diagnosis), asked.limits
    if not known.model.dof.wraps:
        source, motion = known.stored.source, known.model.dof.name
        raise ModelError(f"{source} is a model of {motion}; give a model of yaw, for no other campaigns are planned")
    allowed = limits if isinstance(limits, Limits) else Limits() if limits is None else read_limits(limits)
    names, tests = given_columns(asked.columns), asked.thruster_tests
    drive = drive_for(asked.thrusters, asked.arm, names, known, allowed)
    largest = largest_moment(known, allowed, drive)
    records = load_thruster_logs(tests, names, progress=progress).records if tests else None
    per_test = int(names.defaults.get("thrusters_per_test", 1))
    supply, source = supply_for(allowed, largest, known.stored.moment_unit, drive, per_test, records)

    def work() -> Plan:
        found = plan_campaign(
            known, allowed, largest, supply, wanted=asked.parameters, seed=asked.seed, progress=progress
        )
        return Plan(found, known.stored.source, drive, supply, source, asked.seed)

    return work


def write_plan(folder: ResultFolder, result: Plan, asked: PlanOptions) -> None:
    """The plan's files into a folder."""
    made, names = result.campaign, given_columns(asked.columns)
    spec, missing = specification(made, result.seed)
    rehearsal = missing
    if spec:
        rehearsal = f"Rehearse it with `automarine simulate plan.toml -o out/rehearsal`. {missing}".rstrip()
        folder.write("plan.toml", toml_text(spec))
    folder.write("plan.md", plan_page.page(made, result.model, result.source, rehearsal))
    folder.write("plan.csv", plan_tables.sheet_csv(made))
    folder.write_json(PLAN.file, result.to_json())
    unit, rest = made.fitting.model.moment_unit, made.limits.runs.rest_before_s
    for slot in made.slots:
        content = command_file(slot.candidate, rest, unit, result.drive, names)
        folder.write(plan_tables.command_name(slot.name), content)
    write_figures(folder, {"plan": lambda: plan_figure(made)}, asked.figure_formats)


def _slot_json(made: Campaign, place: int) -> dict[str, object]:
    slot, one = made.slots[place], made.slots[place].candidate
    return {
        "number": slot.number,
        "name": slot.name,
        "kind": one.kind,
        "begins_s": slot.begins,
        "start_heading_deg": one.start_heading,
        "turn_there_deg": float(made.ways_back[place]),
        "turns_deg": float(made.turns[place]),
        "voltage_V": one.voltage,
        "commands": [[moment, seconds] for moment, seconds in one.commands],
        "wait_s": slot.wait,
        "battery_left_Ah": slot.left,
        "command_file": plan_tables.command_name(slot.name),
        "why": made.why[place],
    }


def _split_json(one: Split, grid: Split) -> dict[str, object]:
    return {"true": one.true, "other": one.other, "evidence": one.evidence, "evidence_of_grid": grid.evidence}


def _json(one: Estimate | None) -> dict[str, object] | None:
    return None if one is None else one.to_json()


def _lines(result: Plan) -> Iterator[str]:
    yield from plan_tables.total_sentences(result.campaign)
    dof = result.campaign.fitting.model.dof
    yield "Predicted, of the new runs alone:"
    yield from aligned({plan_tables.in_print(name, dof): one for name, one in result.campaign.alone.items()})


def _rows(result: Plan) -> Iterator[Row]:
    yield from (_slot_json(result.campaign, place) for place in range(len(result.campaign.slots)))


plan = Command(
    "plan", PlanOptions, _plan,
    {Plan: View(Plan.tables, _lines, _rows, lambda result: {"precision": lambda: plan_figure(result.campaign)})},
    files=lambda result: FILES,
)  # fmt: skip
