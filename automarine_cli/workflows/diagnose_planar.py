"""`diagnose` of a planar model: which coupling, current or actuator effect it lacks, by innovations."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import split_off
from automarine_cli.diagnosis.planar import SAYS, Candidate, Contender, PlanarSearch, Step, find_missing
from automarine_cli.dofs import YAW
from automarine_cli.errors import SettingError
from automarine_cli.fits.driven_fit import Worth
from automarine_cli.fits.driven_use import JUDGED
from automarine_cli.fits.planar_fit import PlanarFit, Tried
from automarine_cli.fits.planar_structure import Observed, Structure, observed
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.models.planar_store import load_planar_model, planar_json
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.report.tables import Table, number
from automarine_cli.runs.run import Run, SetAside, readings
from automarine_cli.workflows.planar_runs import load_planar

SCHEMA = "automarine/diagnosis/1"


@dataclass(frozen=True)
class PlanarDiagnosis:
    """What was found of a planar model on `runs`, with `kept` held out; what was set aside, and the file's hash."""

    found: PlanarSearch
    runs: tuple[Run, ...]
    kept: tuple[Run, ...]
    seen: Observed
    set_aside: tuple[SetAside, ...]
    parent: str

    def _fit_of(self, one: Contender) -> PlanarFit:
        """The estimates of a contender, as a fit shows them."""
        return PlanarFit((Tried(Structure.simplest(self.seen), one.found),), self.runs, self.seen)

    def _effect(self, one: Contender, rivals: Sequence[Contender]) -> dict[str, object]:
        """A named or suspected effect, with its odds among its rivals."""
        weights = np.exp([0.5 * (rival.surplus - one.surplus) for rival in rivals])
        total, estimates = 1.0 + float(np.sum(weights)), self._fit_of(one).estimates
        return {
            "name": one.candidate.name,
            "law": "surge, sway and yaw",
            "says": says(one.candidate),
            "parameters": {name: estimates[name].to_json() for name in one.candidate.added},
            "confidence": 1.0 / total,
            "deviance_gained": one.surplus,
            "held_out_log_likelihood_gained": one.held_out,
            "rivals": [
                {
                    "name": rival.candidate.name,
                    "confidence": float(weight) / total,
                    "says": says(rival.candidate),
                }
                for rival, weight in zip(rivals, weights)
            ],
        }

    def to_json(self) -> dict[str, object]:
        """The result: schema automarine/diagnosis/1."""
        found = self.found
        listed: Sequence[Step] = found.steps or [Step(one, ()) for one in found.suspected]
        ahead = {
            name: _gap(*pair)
            for name, pair in (("fitted_runs", found.fitted), ("held_out_runs", found.held_out))
        }
        return {
            "schema": SCHEMA,
            "motion": "planar",
            "verdict": found.verdict,
            "effects": [self._effect(step.best, step.rivals) for step in listed],
            "where": [],
            "gap": {name: _judged(each) for name, each in ahead.items()},
            "prediction": ahead,
            "runs": {
                "used": len(self.runs),
                "held_out": [run.name for run in self.kept],
                "set_aside": [asdict(one) for one in self.set_aside],
                **readings([*self.runs, *self.kept]),
            },
        }  # fmt: skip

    def extended_model(self) -> dict[str, object]:
        """The model with what was named: schema automarine/planar-model/1."""
        after = self.found.after
        model = after.model.model
        names = [step.best.candidate.name for step in self.found.steps]
        return {**planar_json(model), "effects": names, "parent": self.parent}

    def tables(self) -> list[Table | str]:
        """The verdict, the evidence, the predictions."""
        found, said = self.found, list[Table | str]()
        said.append(f"Verdict: {found.verdict}.")
        for step in found.steps:
            said.append(f"{step.best.candidate.name}: {says(step.best.candidate)}")
        listed = [(step.best, "named") for step in found.steps]
        listed += [(one, "rival") for step in found.steps for one in step.rivals]
        listed += [(one, "suspected") for one in found.suspected]
        rows = [
            (
                one.candidate.name,
                ", ".join(one.candidate.added),
                number(one.surplus, 4),
                number(one.held_out, 4),
                kind,
            )
            for one, kind in listed
        ]
        header = ("effect", "parameters", "deviance gained", "held-out log likelihood gained", "is")
        if rows:
            said.append(Table("Evidence", header, tuple(rows)))
        before, after = found.held_out
        said.append(
            Table(
                "Heading predicted on held-out runs, error in deg",
                ("s ahead", "before", "after", "constant rate", "constant heading"),
                tuple(
                    (f"{b.horizon:g}", *(number(float(YAW.shown(x)), 3) for x in (
                        b.error, a.error, b.constant_rate, b.constant
                    )))
                    for b, a in zip(before, after)
                ),
            )
        )  # fmt: skip
        return said


def says(one: Candidate) -> str:
    """What an effect is, and by which parameters."""
    what = SAYS.get(one.name) or effects.get(one.name).card(YAW).says.rstrip(".")
    return f"{what} ({', '.join(one.added)})."


def _gap(before: Sequence[Worth], after: Sequence[Worth]) -> list[dict[str, float]]:
    """Errors of the heading by horizon [deg]."""
    return [
        {
            "horizon_s": b.horizon,
            "before_deg": float(YAW.shown(b.error)),
            "after_deg": float(YAW.shown(a.error)),
            "constant_rate_deg": float(YAW.shown(b.constant_rate)),
            "constant_heading_deg": float(YAW.shown(b.constant)),
        }
        for b, a in zip(before, after)
    ]


def _judged(each: Sequence[dict[str, float]]) -> dict[str, float] | None:
    """The horizon that decides, or the longest below it."""
    return max(
        (one for one in each if one["horizon_s"] <= JUDGED), key=lambda one: one["horizon_s"], default=None
    )


def diagnose_planar(
    logs: Sequence[str | Path],
    *,
    model: Path,
    hold_out: Sequence[str | Path] = (),
    columns: Path | ColumnMap | None = None,
    thrusters: Path | None = None,
    arm: float | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    strict: bool = False,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress = silent,
) -> PlanarDiagnosis:
    """Name what the planar model of the file `model` lacks on planar logs; writes the results if `out` is given.

    `hold_out` logs are never fitted; without any a quarter of the runs, drawn with `seed`, is held out. Raises
    LogError, RunError, ModelError, FitError, SettingError or OutputError.
    """
    stored, names = load_planar_model(model), given_columns(columns)
    campaign = load_planar(logs, names, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
    other = (
        load_planar(hold_out, names, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
        if hold_out
        else None
    )
    runs, kept = (campaign.runs, other.runs) if other else split_off(campaign.runs, seed)
    seen = observed(campaign.runs)
    if not kept:
        raise SettingError("no run is held out: expected at least four logs, or some given with --hold-out")
    aside = (*campaign.set_aside, *(other.set_aside if other else ()))
    parent = hashlib.sha256(model.read_bytes()).hexdigest()

    def work() -> PlanarDiagnosis:
        found = find_missing(stored, runs, kept, seen)
        return PlanarDiagnosis(found, tuple(runs), tuple(kept), seen, aside, parent)

    if out is None:
        return work()
    more = other.inputs if other else ()
    inputs = [Input(file.name, file.path) for file in campaign.inputs]
    inputs += [Input(file.name, file.path, "hold_out") for file in more]
    inputs += given_as(model=model, columns=columns, dbc=names.database, thrusters=thrusters)
    options: dict[str, Any] = {
        "model": model, "hold_out": [file.name for file in more], "columns": columns, "thrusters": thrusters,
        "arm": arm, "strict": strict,
    }  # fmt: skip
    with result_folder(
        out, command="diagnose", options=options, inputs=inputs, seed=seed, overwrite=overwrite
    ) as folder:
        result = work()
        folder.write_json("diagnosis.json", result.to_json())
        folder.write_json("extended_model.json", result.extended_model())
        told = [one if isinstance(one, str) else one.to_markdown() for one in result.tables()]
        folder.write("diagnosis.md", "\n\n".join(told) + "\n")
    return result
