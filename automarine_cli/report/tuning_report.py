"""What `tune` shows and writes: gains and what to expect of them, and a log flown with them beside that."""

import math

import numpy as np

from automarine_cli.control.tuning import TUNING, Tuning, TuningCheck, cell, headlines, labels, margins_of, promises
from automarine_cli.report.sections import Content, Drawing, Sections, bullets, document, sections
from automarine_cli.report.tables import MISSING, Table, number

VERDICTS = {
    "gains": "New gains.", "leave": "Leave the gains as they are.", "cannot-promise": "No promise can be made.",
}  # fmt: skip
FIRST_FLIGHT = (
    "Load it, hold a heading in open water with a hand on the switch to manual, make one step, and let "
    "`automarine tune tuning.json --check LOG` say whether the loop does what is promised."
)


@sections.register
def _(tuning: Tuning) -> Sections:
    listed = [TUNING.file, "tuning.md", "tuning.csv", "gains.csv", "tuning.png"]
    says = _sentences(tuning)
    tables = [] if tuning.new is None and tuning.old is None else [_gains_table(tuning), _promised_table(tuning)]
    files: dict[str, Content] = {TUNING.file: tuning.to_json(), "tuning.md": _page(tuning, tables)}
    files |= {name: table.to_csv() for name, table in zip(("gains.csv", "tuning.csv"), tables)}
    figures: dict[str, Drawing] = {"tuning": Drawing("parameters.tuning_figure", tuning)} if tables else {}
    if tuning.new is not None:
        listed.insert(0, tuning.target.file)
        files[tuning.target.file] = tuning.target_text()
    rows = [{"parameter": name} | gain for name, gain in tuning.gains().items()]
    return Sections([*says, *tuning.knowledge.notes, *tables[:1]], files, figures, listed, rows, details=tables[1:])


def _sentences(tuning: Tuning) -> list[str]:
    settles = [f"What would settle it: {tuning.run}."] if tuning.run else []
    return [f"{VERDICTS[tuning.verdict]} {tuning.why}", *headlines(tuning), *settles]


def _gains_table(tuning: Tuning) -> Table:
    after, before = ({} if of is None else of.gains for of in (tuning.new, tuning.old))
    rows = [
        {
            "parameter": gain.name, "present": number(before.get(gain.name)), "new": number(after.get(gain.name)),
            "unit": gain.unit.replace("{x}", tuning.nominal.dof.units.base),
            "documented": f"{gain.low:g} to {gain.high:g}" if math.isfinite(gain.high) else None,
            "what it is": gain.meaning,
        }
        for gain in tuning.target.parameters
        if gain.searched or after.get(gain.name) not in (None, before.get(gain.name))
    ]  # fmt: skip
    return Table.of("Gains", rows)


def _promised_table(tuning: Tuning) -> Table:
    dof, task = tuning.nominal.dof, tuning.task
    words = labels(tuning) | {
        "settles": "share that settles", "keeps": f"share with a disk margin of {task.margin:g}",
        "rejects": "share that rejects the load",
    }  # fmt: skip
    columns = dict[str, dict[str, str]]()
    for name, outcome in tuning.outcomes():
        columns[name] = {key: cell(of) for key, of in (margins_of(outcome) | promises(outcome, dof)).items()}
        columns[name]["settles"] = f"{100 * np.mean(outcome.scores.settles):.0f} %"
        columns[name]["keeps"] = f"{100 * outcome.share_with(task.margin):.0f} %"
        columns[name]["rejects"] = f"{100 * np.mean(outcome.scores.left <= task.band):.0f} %"
    rows = [{"": label} | {name: cells[key] for name, cells in columns.items()} for key, label in words.items()]
    count = sum(len(crowd) for crowd in tuning.crowds)
    return Table.of("What to expect", rows, [
        f"Median and the band of 95 % of {count} vehicles that the model allows; a step of {dof.logged(task.step):g} "
        f"{dof.units.log}, settled within {dof.shown(task.band):g} {dof.units.shown}, "
        f"flights of {0.5 * task.seconds:.0f} s.",
    ])  # fmt: skip


def _page(tuning: Tuning, tables: list[Table]) -> str:
    nominal, noise = tuning.nominal, tuning.crowds[0].noise[0]
    parts = [f"# A controller for {tuning.target.name}, from {tuning.source}", *_sentences(tuning)]
    if tuning.new is not None:
        parts.append(f"The file to load: `{tuning.target.file}`. {FIRST_FLIGHT}")
    picture = "![Step and load with present and new gains](tuning.png)" if tables else ""
    rests_on = [
        *tuning.knowledge.notes,
        f"Explanations flown: {', '.join(crowd.name for crowd in tuning.crowds)}.",
        f"The whole output gives {nominal.authority}.",
        f"Only {nominal.dof.name} is designed; roll, pitch, and what the motions do to each other are not.",
        f"Readings are off as those of the logs are, by {nominal.dof.shown(noise):.2g} {nominal.dof.words.units} "
        "(standard deviation); waves and the pilot are not simulated.",
    ]
    if tuning.target.firmware:
        rests_on.append(f"Names, units and ranges are those of {tuning.target.firmware}.")
    return document(*parts, *tables, picture, "## What it rests on", bullets(rests_on))


@sections.register
def _(check: TuningCheck) -> Sections:
    dof, steps, rows, unit = check.dof, check.steps, list[dict[str, object]](), check.dof.units.shown
    words = ("overshoot [%]", "settles after [s]", f"error from then on, rms [{unit}]")
    for step in steps:
        size = f"{dof.logged(step.size):+.3g} {dof.units.log}"
        for label, figure in zip(words, step.figures.values()):
            sizes = (figure["flown"], *figure["promised"])
            flown, low, high = (number(size, 3).replace(MISSING, "never") for size in sizes)
            rows.append({
                "step": f"{step.run}, {step.begins:.1f} s, {size}", "": label, "flown": flown,
                "promised": f"{low} to {high}", "held": "yes" if figure["held"] else "no",
            })  # fmt: skip
    table = Table.of("Flown and promised", rows)
    failed = sum(not step.held for step in steps)
    verdict = f"Not as promised: {failed} of {len(steps)} steps leave the bands of 95 %."
    if not failed:
        verdict = f"As promised: all {f'{len(steps)} steps are' if len(steps) > 1 else 'is'} within the bands."
    picture = "![Steps as flown, and the bands that were promised](tuning_check.png)"
    page = document("# A log beside what was promised", verdict, table, picture)
    files: dict[str, Content] = {"tuning_check.json": check.to_json(), "tuning_check.md": page}
    figures = {"tuning_check": Drawing("parameters.flown_figure", steps, dof)}
    return Sections((verdict, table), files, figures, rows=check.to_json()["steps"])
