"""What `diagnose` shows of a model of one motion, of the plane or of a thruster map: the verdict in a sentence, tables,
the page for a person, figures."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from automarine_cli import effects as library
from automarine_cli.diagnosis import verdict as words
from automarine_cli.diagnosis.diagnose import Diagnosis, NamedEffect
from automarine_cli.diagnosis.residual_regions import Region
from automarine_cli.diagnosis.scores import CLAIM_LEVEL
from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis
from automarine_cli.diagnosis.trials import BASE_DRAG
from automarine_cli.dofs import YAW, Dof
from automarine_cli.estimate import Estimate
from automarine_cli.fits.driven import ForecastScore
from automarine_cli.fits.innovations import sensors_of
from automarine_cli.models.model import label_of
from automarine_cli.report.log_tables import sensor_sentences
from automarine_cli.report.sections import Drawing, Sections, bullets, document, sections
from automarine_cli.report.tables import MISSING, Table, escape, number, with_band
from automarine_cli.report.thruster_tables import cells, parameter_cell
from automarine_cli.runs.run import command_warnings
from automarine_cli.text import plural
from automarine_cli.thrusters.curves import FORMS
from automarine_cli.thrusters.selection import ALPHA

MORE = {"p_value": "p", "cv_rmse_N": "cross-validated error [N]"}  # of candidates
OF = {"moment": "a moment", "gain": "a gain", "drag": "linear drag"}  # kinds of learned curves in words
PLANNED = "`automarine plan MODEL --diagnosis diagnosis.json` plans the runs that separate them."
PROMISED = (
    " beyond the penalty. Not fitted were those whose score, the slope of the likelihood, promised less than others, "
    "or less than the threshold."
)
CLOSE = 0.2  # weight of a rival from which on the first line names it too
LARGE_MOVE = 2.0  # standard errors: a base parameter that moved by more had been absorbing something
MAX_CANDIDATES, MAX_RIVALS = 5, 3
OWN_THRUST, ALONE = ", own thrust and start", ", from the commands alone"  # how whole runs are simulated
HELD_OUT = "No effect or drag is fitted to runs held out; from the commands alone nothing is (with 95 % intervals). "
ERRORS = "Errors of the worst runs without and with what is missing, and the root mean square of every run"
WHERE = "Mean error by each variable; where a band is yellow, it is more than chance"
WHY = "Evidence that each effect gains, beside the threshold that chance hardly reaches"


def _sections(
    result: Diagnosis | ThrusterDiagnosis, extended: Mapping[str, object], title: str, verdict: str,
    before_after: Drawing, *, notes: tuple[str, str], unit: str = "deg", dof: Dof | None = None,
    above: Sequence[str] = (), below: Sequence[str] = (), appendix: Sequence[Table | str] = (), caption: str = "",
) -> Sections:  # fmt: skip
    """Lay out a diagnosis of any kind, whose JSON has one shape: `above` and `below` the verdict stand lines, `notes`
    explain error and threshold; `appendix` is on the page alone; the `caption` goes on from before and after."""
    data: dict[str, Any] = result.to_json()
    effects, regions = result.effects, regions_table(result.where.regions, unit)
    tried, gaps = candidates(data, effects), gap_tables(data, unit, notes[0])
    threshold = f"Significance threshold: {number(data['threshold'], 3)}{notes[1]}"
    fitted = [row for row in tried if row["is"] != "not fitted"][:MAX_CANDIDATES]
    table = Table.of("Candidates", fitted, [threshold], header=("effect", "evidence gained", "is"))
    drawings = {
        "where": Drawing("diagnosis.where_figure", result.where),
        "why": Drawing("diagnosis.why_figure", tried, data["threshold"], f"threshold{notes[1].partition('.')[0]}"),
        "before_after": before_after,
    }
    lines, rows, page = [*above, verdict], list[dict[str, Any]](), list[Table | str]()
    for effect in effects:
        name = effect.title
        lines += [f"{name}: {effect.says}", *_rivals(effect)]
        parameters = list(parameter_rows(effect, dof))
        page += _effect(effect, dof, parameters)
        if effect.learned is not None:
            drawings["learned"] = Drawing("diagnosis.learned_figure", effect.learned, dof or YAW)
        for row in parameters:
            columns = {head: value for head, value in row.items() if head != "meaning"}
            rows.append({"effect": name, **columns, "confidence": f"{100 * effect.confidence:.0f} %"})
    change: list[Table | str] = ["## The error before and after", *gaps, f"![{ERRORS}{caption}](before_after.png)"]
    change += _moves(data) if "base" in data and data["verdict"] == words.NAMED else []
    if data["verdict"] == words.NOTHING:  # nothing changes: what would have shown stands in its place
        gaps, change, appendix = [part for part in appendix if isinstance(part, Table)], [*appendix], ()
    text = document(
        f"# {title}", escape(verdict), *map(escape, below), *page, *change,
        "## Where the gap is", *regions, f"![{WHERE}](where.png)",
        "## Why", table, f"![{WHY}](why.png)", *appendix,
    )  # fmt: skip
    return Sections(
        [*lines, *below, *([Table.of("Effects", rows)] if rows else []), *gaps, table],
        {"diagnosis.json": data, "extended_model.json": extended, "diagnosis.md": text}, drawings,
        rows=[
            {"effect": effect.title, "confidence": effect.confidence, "parameter": name, **cells(value)}
            for effect in effects
            for name, value in effect.parameters.items()
        ],
    )  # fmt: skip


def _rivals(effect: NamedEffect) -> list[str]:
    lines = [
        f"Cannot be excluded: {rival.title} (weight {100 * rival.confidence:.0f} %). Told apart by {rival.split_by}."
        for rival in effect.rivals[:MAX_RIVALS]
    ]
    more = len(effect.rivals) - MAX_RIVALS
    return [*lines, f"Not excluded are {more} more, which diagnosis.json lists."] if more > 0 else lines


def _effect(effect: NamedEffect, dof: Dof | None, parameters: Sequence[Mapping[str, Any]]) -> Iterator[Table | str]:
    """Give an effect's part of the page, with its law where it is one of a motion."""
    law = dof and library.get(effect.name).law_at([estimate.value for estimate in effect.parameters.values()])
    yield from (f"## {effect.title}", effect.says)
    if dof and law:
        yield f"`{dof.fill(law.equation)}`"
    yield Table.of("", parameters)
    yield f"Confidence that it is this effect: {100 * effect.confidence:.0f} %."
    yield bullets(map(escape, _rivals(effect)))
    if effect.learned is not None:
        yield "![What was learned](learned.png)\n\nThe curve as a table is in diagnosis.json, under `learned`."
    if law:
        yield f"Source: {law.source}."


def parameter_rows(effect: NamedEffect, dof: Dof | None) -> Iterator[dict[str, Any]]:
    """Rows of an effect's parameters, without those of laws that do not hold; of a choice between laws the word."""
    if (curve := effect.learned) is not None:
        scale, unit = (100.0, "%") if curve.kind == "gain" else (1.0, curve.y_unit)
        low, high = scale * curve.y.min(), scale * curve.y.max()
        cell = f"{low:+.3g} to {high:+.3g} {unit} over {number(curve.x[0], 3)} to {number(curve.x[-1], 3)}"
        yield {"parameter": f"curve of {OF[curve.kind]}", "estimate": cell, "unit": curve.unit}
        return
    if dof is None:
        for name, estimate in effect.parameters.items():
            yield {"parameter": name, "estimate": parameter_cell(estimate), "unit": estimate.unit}
        return
    kind, values = library.get(effect.name), [estimate.value for estimate in effect.parameters.values()]
    described = zip(kind.parameters, kind.card(dof).parameters, effect.parameters.items())
    for parameter, card, (name, estimate) in described:
        if kind.counts(parameter, values):
            cell = parameter.choices[round(estimate.value)] if parameter.choices else estimate
            yield {"parameter": name, "estimate": cell, "unit": estimate.unit, "meaning": card.meaning}


def candidates(data: Mapping[str, Any], effects: Sequence[NamedEffect]) -> list[dict[str, Any]]:
    """Rows of the candidates of the first look of a `diagnosis.json`, with what became of each, best first."""
    status = dict.fromkeys((rival.title for effect in effects for rival in effect.rivals), "rival")
    status |= dict.fromkeys((effect.title for effect in effects), data["verdict"])
    rows = []
    for entry in data["candidates"]:
        added = entry.get("parameters", ())
        name = label_of(entry["name"], added) if added else f"{entry['name']} {entry.get('where', '')}".rstrip()
        row = {"effect": name, "evidence gained": entry["gain"]}
        row |= {head: number(entry[key], 3) for key, head in MORE.items() if key in entry}
        otherwise = "not needed" if entry.get("fitted", True) else "not fitted"
        rows.append({**row, "is": status.get(name, otherwise)})
    return rows


def gap_tables(data: Mapping[str, Any], unit: str, note: str) -> list[Table]:
    """Root mean squares before and after of a `diagnosis.json`, on data fitted and held out: of predictions by horizon
    where runs are driven, else of whole runs, each with what is fitted to it and without; none where there is none."""
    rows = []
    for name, outlook in data.get("prediction", {}).items():
        for errors in outlook["horizons"] if outlook else ():
            heads = {head: head.removesuffix(f"_{unit}").replace("_", " ") for head in errors if head != "horizon_s"}
            row = {f"{word} [{unit}]": f"{errors[head]:.2f}" for head, word in heads.items()}
            rows.append({"predicted": f"{name.replace('_', ' ')}, {errors['horizon_s']:g} s ahead", **row})
    if rows:
        return [Table.of("Predictions from the filtered state", rows, [
            "Root mean square errors; the filter knows the readings until each prediction begins, and the commands "
            "after it as they were logged.",
        ])]  # fmt: skip
    free = data.get("from_commands", {})
    for how, gaps in ((OWN_THRUST if free else "", data["gap"]), (ALONE, free)):
        for name, sizes in ((name, sizes) for name, sizes in gaps.items() if sizes is not None):
            before, after, floor = (sizes[f"{word}_{unit}"] for word in ("before", "after", "noise_floor"))
            closed = MISSING
            if before and after and (above := before**2 - floor**2) > 0.02 * floor**2:
                closed = f"{100 * np.clip((before**2 - after**2) / above, 0.0, 1.0):.0f} %"
            columns = dict(zip((f"before [{unit}]", f"after [{unit}]"), errors_of(sizes, unit)))
            label = name.replace("_", " ").replace("runs", "levels" if "levels" in data else "runs") + how
            noise = {f"noise [{unit}]": number(floor, 3), "closed above the noise": closed}
            rows.append({"error": label, **columns, **noise})
    return [Table.of("", rows, [note])] if rows else []


def errors_of(sizes: Mapping[str, Any], key: str) -> list[str]:
    """Show errors before and after, with intervals where they have some; infinity of a free run that diverges."""
    errors = ((sizes[f"{word}_{key}"], sizes.get(f"{word}_ci95")) for word in ("before", "after"))
    return ["∞" if size is None else with_band(size, ends) for size, ends in errors]


def regions_table(regions: Sequence[Region], unit: str) -> list[Table]:
    """Lay out the regions that stand out, the most significant first; gaps in `unit`."""
    rows = [
        {"variable": region.variable, "from": number(region.low, 3), "to": number(region.high, 3),
         "unit": region.unit or MISSING, f"gap [{unit}]": number(region.gap, 3),
         "share of the gap": f"{100 * region.share:.0f} %", "p": number(region.p_value, 2), "runs": len(region.runs)}
        for region in regions
    ]  # fmt: skip
    note = (
        "p is corrected for all bins and variables. Shares of different variables overlap: they are views of one gap."
    )
    return [Table.of("", rows, [note])] if rows else []


def _forecast(pair: tuple[ForecastScore, ForecastScore], dof: Dof) -> tuple[list[str], str]:
    """The errors of predictions before and after, and in words those of somebody who expects no change."""
    (before, after), words = pair, dof.words
    errors = before.error, after.error, before.constant_rate, before.constant
    *sizes, rate, constant = (f"{dof.shown(error):.2f}" for error in errors)
    misses = f"a constant {words.speed} misses by {rate} and a constant {words.position} by {constant}"
    return sizes, f"{misses} {dof.units.shown}"


def _verdict(
    word: str, names: str, why: str, quantity: str, sizes: Sequence[str], unit: str, reference: str,
    data: str = "runs could show", remaining: str = "", alone: Sequence[str] = (),
) -> str:  # fmt: skip
    """The verdict in words, of motions, the plane and maps alike; the `quantity` has these `sizes`, before and after,
    and from the commands `alone` those."""
    beside = f". {reference[0].upper()}{reference[1:]}." if reference.startswith("a constant") else f" ({reference})."
    goes = "{0} goes from {1} to {2} {3}" if word == words.NAMED else "{0} is {1} {3}"
    errors = {f"The {quantity}": sizes} | ({"From the commands alone it": alone} if alone else {})
    gap = ". ".join(goes.format(what, *pair, unit) for what, pair in errors.items()) + beside
    return {
        words.NAMED: f"Named: {names}. {gap} {remaining}",
        words.SUSPECTED: f"Suspected, not named: {names}. {why}",
        words.UNEXPLAINED: f"Unexplained. {gap} {why}",
        words.NOTHING: f"Nothing missing that these {data}. {gap}",
    }[word].rstrip()


def _with_rivals(effect: NamedEffect) -> str:
    """The title of a named effect, and where it may well be another its weight and what is nearly as likely."""
    close = [(rival.title, rival.confidence) for rival in effect.rivals if rival.confidence > CLOSE]
    shares = [f"{name} ({100 * weight:.0f} %)" for name, weight in ((effect.title, effect.confidence), *close)]
    return " or ".join(shares) if effect.confidence < 1.0 - CLOSE else effect.title


def verdict_sentence(diagnosis: Diagnosis) -> str:
    dof, part, plane, effects = diagnosis.dof, diagnosis.decisive, diagnosis.motion.turns, diagnosis.effects
    unit, free, data = dof.units.shown, diagnosis.from_commands, "runs could show"
    sizes = errors_of(part.gap.to_json(unit, dof.shown), unit)
    alone = errors_of(free.to_json(unit), unit) if free else []
    of = " of the fitted runs" if part is diagnosis.fitted else f" of the {plural(len(part.runs), 'run')} held out"
    drag = [effect.name for effect in effects if effect.name in BASE_DRAG and not plane]
    named = diagnosis.verdict == words.NAMED
    counted = [_with_rivals(effect) if named else effect.title for effect in effects if effect.title not in drag]
    names = " and ".join(counted or drag)
    if counted and drag:
        names += f", where {' and '.join(drag)} puts the drag of the base right"
    noise = f"noise of the {dof.words.position} {number(dof.shown(part.gap.floor), 3)} {unit}"
    what, level = f"error{of}, with each run's{OWN_THRUST[1:]},", noise
    if diagnosis.driven:
        what, level = f"error of the {dof.words.position}{of}", "no run is long enough for predictions"
        sizes = [MISSING, MISSING]
        if part.outlook is not None:
            sizes, level = _forecast(part.outlook.longest, dof)
            what = f"error of the {dof.words.position} predicted {part.outlook.longest[0].horizon:g} s ahead{of}"
        if not plane:
            level, data = f"{level}, {noise}", f"{data} beside their disturbances"
    return _verdict(diagnosis.verdict, names, diagnosis.why, what, sizes, unit, level, data, diagnosis.remainder, alone)


@sections.register
def _(diagnosis: Diagnosis) -> Sections:
    title = f"Diagnosis of the {diagnosis.motion.name} model"
    show = partial(_sections, diagnosis, diagnosis.extended_model(), title, verdict_sentence(diagnosis))
    if diagnosis.motion.turns:
        return show(Drawing("diagnosis.before_after", diagnosis), notes=("", PROMISED))
    dof, free = diagnosis.dof, diagnosis.from_commands
    below = [PLANNED] if any(effect.rivals for effect in diagnosis.effects) else []
    below += [diagnosis.cycle.sentence(dof)] if diagnosis.cycle is not None else []
    unit, alone = dof.units.shown, ""
    if free:
        sizes = errors_of(free.to_json(unit), unit)
        alone = f"From the commands alone: {sizes[0]} {unit} before, {sizes[1]} {unit} after"
    before, after = (100.0 * scatter for scatter in diagnosis.gain_scatter)
    gap = (
        "Root mean squares over whole runs simulated from their start. Before: the base refitted to the fitted runs. "
        f"Own: each run's thrust, start {dof.words.position} and switch instants are fitted to it. "
        f"{HELD_OUT if free else ''}"
        f"Thrust differs from run to run by {before:.1f} % before and {after:.1f} % after."
    )
    chance = f", which chance reaches in {1000 * CLAIM_LEVEL:.0f} of 1000 campaigns."
    better = bullets(library.get(effect.name).card(dof).better for effect in diagnosis.effects)
    appendix: list[Table | str] = ["## What to run next", better] if better else []
    if diagnosis.verdict != words.NAMED:
        appendix.append(detectable_table(diagnosis))
    caption = f", with each run's own thrust and start. {alone}." if free else ""
    return show(
        Drawing("diagnosis.before_after", diagnosis, alone), notes=(gap, chance), unit=unit, dof=dof,
        above=[f"Warning: {warning}" for warning in command_warnings(diagnosis.fitted.runs)],
        below=[*below, *sensor_sentences(sensors_of(diagnosis.channels, diagnosis.noises), dof)],
        appendix=appendix, caption=caption.translate({ord("["): "(", ord("]"): ")"}),  # brackets would end it
    )  # fmt: skip


def _moves(data: Mapping[str, Any]) -> list[Table | str]:
    """Lay out the parameters of the base model of a `diagnosis.json` before and after, and say which moved."""
    rows, moved = [], list[str]()
    for name, sizes in data["base"].items():
        old, new = (Estimate(**sizes[key]) for key in ("before", "after"))
        change = f"{100 * (new.value - old.value) / old.value:+.1f} %" if old.value else MISSING
        row = {"parameter": name, "with what was missing": new, "change": change}
        rows.append(row | {"base model": old, "unit": new.unit})
        if abs(new.value - old.value) > LARGE_MOVE * float(np.hypot(old.stderr, new.stderr)):
            moved.append(name)
    sentence = f"The base model is fitted anew to these {data['runs']['used']} runs: it is not quite that of the file."
    if moved:
        absorbed = "the base model had absorbed part of what is missing"
        sentence = f"{' and '.join(moved)} moved by more than the uncertainty: {absorbed}. {sentence}"
    return ["## What it does to the model", Table.of("", rows), sentence]


def detectable_table(diagnosis: Diagnosis) -> Table:
    """Lay out the smallest size of each effect that would have been named four times in five."""
    rows = []
    for name, size in sorted(diagnosis.detectable.items()):
        parameters = library.get(name).parameters
        sized = next((i for i, p in enumerate(parameters) if not p.scan and not p.held), 0)  # no shape, and fitted
        card = library.get(name).card(diagnosis.dof, diagnosis.moment_unit).parameters[sized]
        unit = card.unit or MISSING
        rows.append({"effect": name, "parameter": card.name, "smallest size seen": number(size, 2), "unit": unit})
    note = "Sizes that these runs detect with 80 % power, measured from the value at which the effect is off."
    header = ("effect", "parameter", "smallest size seen", "unit")
    return Table.of("Smallest effects that these runs would have shown", rows, [note], header=header)


@sections.register
def _(result: ThrusterDiagnosis) -> Sections:
    gap = (
        f"Root mean square errors over levels. Before: the map's form refitted; as given it is "
        f"{number(result.given_rmse, 3)} N off on the fitted levels. The noise is read from {result.floor_from}."
    )
    if FORMS[result.given.form].interpolates:
        gap += " A spline follows any curve: only what differs between readings at one command can be missing."
    chance = (
        f", which chance reaches in {1000 * ALPHA:.0f} of 1000 maps without any effect. p is corrected for the number "
        "of candidates."
    )
    return _sections(
        result, result.extended_map, "Diagnosis of a thruster map", map_verdict(result),
        Drawing("diagnosis.thruster_before_after", result), notes=(gap, chance), unit="N",
        below=[fault["says"] for fault in result.faults],
    )  # fmt: skip


def map_verdict(result: ThrusterDiagnosis) -> str:
    sizes = [number(100.0 * size / result.data.full_scale, 3) for size in (result.cross.before, result.cross.after)]
    reference = f"full scale {number(result.data.full_scale)} N, noise {number(result.gap.floor, 3)} N"
    names = " and ".join(effect.name for effect in result.effects)
    error, data = "cross-validated error", "levels could show"
    return _verdict(result.verdict, names, result.why, error, sizes, "% of full scale", reference, data)
