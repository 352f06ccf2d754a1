"""What `run` shows of a campaign: a row a step with its result in a few words, and cautions that only the campaign as a
whole gives; of several campaigns a row each."""

from dataclasses import dataclass, replace
from pathlib import Path

from automarine_cli.errors import AutomarineError
from automarine_cli.pipeline.manifest import manifest_of
from automarine_cli.pipeline.records import Shown, to_mapping
from automarine_cli.report.campaign_page import FILES, REPORT, STEPS, RunFile, headlines, read_steps
from automarine_cli.report.sections import Content, Sections, sections
from automarine_cli.report.tables import MISSING, Table, number
from automarine_cli.thrusters.map import ThrusterFile, VoltagePower

MOST_NAMED = 12  # campaigns whose folders are named at the end


@dataclass(frozen=True)
class StepOutcome:
    """What became of a step: it was "done", "kept", "skipped" or "refused", why, and what its result says."""

    step: str
    did: str
    why: str = ""
    says: str = ""


@dataclass(frozen=True, repr=False)
class CampaignRun(Shown):
    """What `run` did in the folder `out`: its steps, its result file, and what the steps' manifests warn of."""

    out: Path
    steps: tuple[StepOutcome, ...]
    content: RunFile
    warnings: tuple[str, ...] = ()

    @property
    def says(self) -> dict[str, str]:
        return {step.step: step.says for step in self.steps if step.says}

    @property
    def refused(self) -> tuple[str, ...]:
        """Steps whose data or fit was refused, with the reason."""
        return tuple(f"{step.step}: {step.why}" for step in self.steps if step.did == "refused")

    def to_json(self) -> dict[str, object]:
        """Give the result file: schema automarine/run/1. It does not say what was kept: the bytes are the same."""
        return to_mapping(self.content)


@dataclass(frozen=True)
class CampaignOutcome:
    """What became of one of several campaigns: its name among them, and its run or why it was refused."""

    name: str
    run: CampaignRun | None = None
    refusal: str = ""

    @property
    def refused(self) -> tuple[str, ...]:
        return (self.refusal,) if self.run is None else self.run.refused

    def to_json(self) -> dict[str, object]:
        content, says = (RunFile("", self.name), {}) if self.run is None else (self.run.content, self.run.says)
        steps = [to_mapping(step) | {"says": says.get(step.step, "")} for step in content.steps]
        return {"name": self.name, "title": content.title, "steps": steps, "cautions": list(content.cautions),
                "refused": list(self.refused)}  # fmt: skip


@dataclass(frozen=True, repr=False)
class Campaigns(Shown):
    """What `run` of several campaigns did in the folder `out`, in the order in which they were given."""

    out: Path
    campaigns: tuple[CampaignOutcome, ...]

    @property
    def refused(self) -> tuple[str, ...]:
        return tuple(f"{campaign.name}: {why}" for campaign in self.campaigns for why in campaign.refused)

    @property
    def warnings(self) -> tuple[str, ...]:
        runs = ((campaign.name, campaign.run.warnings) for campaign in self.campaigns if campaign.run)
        return tuple(f"{name}: {warning}" for name, warnings in runs for warning in warnings)

    def to_json(self) -> dict[str, object]:
        """Give the result file: schema automarine/campaigns/1."""
        entries = [campaign.to_json() for campaign in self.campaigns]
        return {"schema": "automarine/campaigns/1", "campaigns": entries}


@sections.register
def _(result: CampaignRun) -> Sections:
    rows = [
        {"step": step.step, "": step.did, "because": (step.did != "refused" and step.why) or MISSING,
         "result": step.says or MISSING}
        for step in result.steps
    ]  # fmt: skip
    done = _done(result.steps)
    page = FILES if REPORT in done else ("run.json",) if REPORT in {step.step for step in result.steps} else ()
    folders = [f"{step.folder}/" for step in STEPS if step.name in done]
    return Sections([Table.of("", rows), *result.content.cautions], listed=(*page, *folders))


@sections.register
def _(result: Campaigns) -> Sections:
    steps = ("fit-yaw", "validate", "diagnose")
    rows = [
        {"campaign": campaign.name}
        | {step: (campaign.run and campaign.run.says.get(step)) or MISSING for step in steps}
        | {"refused": "; ".join(campaign.refused) or MISSING}
        for campaign in result.campaigns
    ]
    table = Table.of("", rows)
    files: dict[str, Content] = {"campaigns.json": result.to_json(), "campaigns.csv": table.to_csv()}
    folders = [f"{campaign.name}/" for campaign in result.campaigns[:MOST_NAMED]]
    return Sections([table], files, listed=("campaigns.csv", "campaigns.json", *folders))


def _done(steps: tuple[StepOutcome, ...]) -> set[str]:
    return {step.step for step in steps if step.did in ("done", "kept")}


def with_results(out: Path, steps: tuple[StepOutcome, ...]) -> tuple[StepOutcome, ...]:
    """Add to the steps what the results in their folders in `out` say."""
    folders = {step.folder for step in STEPS if step.name in _done(steps)}
    try:
        results = read_steps(out)
    except AutomarineError:
        return steps
    says = headlines({folder: step for folder, step in results.items() if folder in folders})
    return tuple(replace(step, says=says.get(step.step, "")) for step in steps)


def warnings_of(out: Path, steps: tuple[StepOutcome, ...]) -> tuple[str, ...]:
    """List what the manifests of the steps in `out` warn of, each with the step's name."""
    manifests = {step.name: manifest_of(out / step.folder) for step in STEPS if step.name in _done(steps)}
    return tuple(f"{name}: {line}" for name, manifest in manifests.items() if manifest for line in manifest.warnings)


ALIKE = 1.03  # voltages that differ by less are one, as in the thruster fit


def cautions(thrusters: ThrusterFile | None, supply: float | None) -> list[str]:
    """Say what does not fit together between the thruster tests and the vehicle: other voltages than its supply."""
    if supply is None or thrusters is None or thrusters.voltage_range_V is None:
        return []
    low, high = thrusters.voltage_range_V
    if low / ALIKE <= supply <= high * ALIKE:
        return []
    nearest, volts = low if supply < low else high, number(supply, 3)
    tested = " to ".join(dict.fromkeys(number(end, 3) for end in (low, high)))
    entries = (
        entry.thrust_at_fixed_n for entry in thrusters.voltage_exponent.values() if isinstance(entry, VoltagePower)
    )
    powers, size = [power.value for power in entries if power is not None and power.value is not None], ""
    if powers and (power := sum(powers) / len(powers)):
        size = (
            f" Thrust grows with the voltage to the power {number(power, 3)}, so expect it to be "
            f"{number((supply / nearest) ** power, 3)} times that at {number(nearest, 3)} V."
        )
    return [
        f"The thrusters were tested at {tested} V, the vehicle's supply is {volts} V: the map is extrapolated.{size} "
        "Test at the supply voltage."
    ]
