"""What the fit of one motion, or of surge, sway and yaw together, shows and writes: tables, sentences, one row a run,
figures."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli import effects
from automarine_cli.dofs import SWAY, YAW, Dof
from automarine_cli.estimate import Estimate
from automarine_cli.fits.characteristics import AMPLITUDE_DEG, AT_AMPLITUDE, Nomoto, Swing, mean_miss
from automarine_cli.fits.driven import ForecastScore, Judgement, unit_of_quantity
from automarine_cli.fits.identify import MIN_NOISE_RATIO, YawFit, effect_estimates
from automarine_cli.fits.innovations import channel_noises, sensors_of
from automarine_cli.fits.linear_mixed import GAIN, START_VELOCITY
from automarine_cli.fits.paper import BIAS_LIMIT, DragFit
from automarine_cli.fits.planar_fit import PlanarFit, criterion
from automarine_cli.fits.planar_structure import structure_of
from automarine_cli.fits.preference import Preference
from automarine_cli.fits.steps import FADING, MIN_P_BENDS, MIN_P_PARAMETERS, STIRRED, Consistency
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.model import COMMAND_DELAY
from automarine_cli.models.parameter import Priors
from automarine_cli.models.store import DRAG_LAWS
from automarine_cli.report.log_tables import sensor_sentences
from automarine_cli.report.sections import Content, Drawing, Sections, document, forms_of, numbers, sections
from automarine_cli.report.tables import Table, interval, number
from automarine_cli.runs.run import shared_readings

CORRELATED = 0.95  # correlation of two estimates from which on only a combination of them is known
INERTIA, DRAG_ROLES = "inertia", ("quadratic", "linear")  # what parameters are
EVERY_ROLE = (INERTIA, *DRAG_ROLES)
REMEDY = {
    "inertia": "add runs from rest, logged faster",
    "quadratic": "add runs at larger {forces}, each held until the {speed} is steady",
    "linear": "add runs at smaller {forces}, each held until the {speed} is steady",
}
"""What shows a parameter, by what it is."""
SWING_REMEDY = {
    "inertia": "add runs with a {force}",
    "quadratic": "add decays from larger angles",
    "linear": "log decays for longer, until they are in the noise",
}
"""The same of a vehicle that swings."""


@dataclass(frozen=True)
class Caution:
    """A sentence on `parameters` (by what they are) of one model ("" for every model): on drag it stands below Table 1,
    on inertia below Table 2. `grave` is one that a person must hear of even where another model is preferred."""

    model: str
    parameters: tuple[str, ...]
    sentence: str
    grave: bool = False


def fit_cautions(fits: Mapping[str, OutputErrorFit]) -> Iterator[Caution]:
    for model, fit in sorted(fits.items()):
        if not fit.mixed.converged:
            after = f"had not converged after {fit.mixed.iterations} iterations"
            says = f"Model {model} {after}; its numbers are rough: do not use them, or add runs."
            yield Caution(model, EVERY_ROLE, says, grave=True)
        for role in EVERY_ROLE:
            yield from _doubts(fit, role)
        yield from _correlations(fit)


def _doubts(fit: OutputErrorFit, role: str) -> Iterator[Caution]:
    """A parameter at its bound, one that the runs never moved, a negative one, or an interval wider than its value."""
    dof = fit.model.dof
    name, remedy = dof.parameters[role], _remedy(role, dof)
    estimate = fit.estimates.get(name)
    if estimate is None or estimate.known:
        return
    i, (low, high) = list(fit.estimates).index(name), estimate.ci95
    band = f"{name} is {estimate.value:.3g} [{low:.3g}, {high:.3g}]"
    says = ""
    if i in fit.mixed.at_bound:
        says = f"{band} and stands at a bound of its range; {remedy}."
    elif fit.covariance[i, i] <= 0.0:
        start = f"{float(fit.mixed.theta[i]):.3g}"
        says = f"{name} never moved from its start, {start}: these runs hold no information on it; {remedy}."
    grave = bool(says)
    if not says and estimate.value < 0:
        why = f"a negative {dof.words.inertia}" if role == INERTIA else "a drag that drives the vehicle"
        mend = "something else acts on these runs: look for it with `automarine diagnose`"
        mend = f"the interval holds zero: take a model without it, or {remedy}" if high >= 0 else mend
        says = f"{band}, {why}, which no vehicle has; {mend}."
    elif not says and not fit.proposed and high - low > estimate.value:
        says = f"{band}, an interval wider than the value; these runs hold little information on it: {remedy}."
    if says:
        yield Caution(fit.number, (role,), f"Model {fit.number}: {says}", grave)


def _remedy(role: str, dof: Dof) -> str:
    return dof.fill((SWING_REMEDY if dof.restoring else REMEDY)[role])


def _correlations(fit: OutputErrorFit) -> list[Caution]:
    """Pairs of parameters of which the runs show a combination only; two drags that are one take the inertia along,
    and stand alone. By the likelihood's covariance: that of a few runs left out scatters by itself."""
    dof, cautions = fit.model.dof, []
    roles = {name: role for role, name in dof.parameters.items()}
    names = list(fit.estimates)
    covariance = fit.mixed.covariance
    deviation = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    for i, j in combinations(range(len(names)), 2):
        product = deviation[i] * deviation[j]
        share = float(covariance[i, j] / product) if product > 0 else 0.0
        pair = (roles[names[i]], roles[names[j]])
        if abs(share) > CORRELATED and set(pair) <= set(EVERY_ROLE) and not {i, j} & set(fit.mixed.at_bound):
            says = f"{names[i]} and {names[j]} are correlated by {share:.3f}; {_combination(pair, share, dof)}"
            cautions.append(Caution(fit.number, pair, f"Model {fit.number}: {says}"))
    return [caution for caution in cautions if caution.parameters == DRAG_ROLES] or cautions


def _combination(pair: tuple[str, str], share: float, dof: Dof) -> str:
    force, speed = dof.words.force, dof.words.speed
    if set(pair) == set(DRAG_ROLES) and dof.restoring:
        return "these runs show their sum better than either: add decays from much smaller and much larger angles."
    if set(pair) == set(DRAG_ROLES):
        return f"these runs determine only their total drag: add runs at much smaller and much larger {force}s."
    if share > 0:
        return "only their ratio is well determined: the thrust scatters; add runs, or measure thrust or voltage."
    more = _remedy(pair[0], dof)
    return f"these runs hardly separate them: hold each {force} until the {speed} is steady, and {more}."


def design_cautions(levels: Sequence[float], unit: str, dof: Dof) -> Iterator[Caution]:
    """What the moments of a campaign, `levels`, cannot show."""
    sides = {float(np.sign(level)) for level in levels if level}
    sizes = sorted({round(abs(level), 9) for level in levels if level})
    words, force, speed = dof.words, dof.words.force, dof.words.speed
    if len(sides) == 1:
        way, opposite = words.to_ways if sides == {1.0} else words.to_ways[::-1]
        says = (
            f"Every run {words.moves} {way}: a {force} that always acts, or thrusters that push less one way, would "
            f"bias {words.inertia} and drag unnoticed; add runs {opposite} at the same {force}s."
        )
        yield Caution("", EVERY_ROLE, says)
    if len(sizes) == 1:
        says = (
            f"Every run commands the same size of {force}, {sizes[0]:g} {unit}: how drag grows with the {speed} shows "
            f"only in how each {words.move} begins; add runs at {0.5 * sizes[0]:.3g} and {2.0 * sizes[0]:.3g} {unit}, "
            "or as much as the thrusters give."
        )
        yield Caution("", DRAG_ROLES, says)


MIN_DECIDING_SHARE = 0.8  # share of the spread over fits without one run from which on that run decides alone
WILD_GAIN = 0.25  # scatter of the thrust from run to run beyond what batteries and water do
MIN_MOVED_STDERRS = 3.0  # standard errors


def cautions_of(fit: YawFit) -> tuple[Caution, ...]:
    """List what the runs and the fits of their models cannot show."""
    levels = [turn.moment for turn in fit.turns] or [float(level) for run in fit.runs for level in run.command]
    return (*design_cautions(levels, fit.moment_unit, fit.dof), *fit_cautions(fit.output_error))


def warnings_of(fit: YawFit) -> tuple[str, ...]:
    """List what a person must know before trusting a fit. Cautions are warnings that are grave, and those on every
    model or on the preferred one; the others only stand below the tables."""
    preference, dof, seed = fit.preference, fit.dof, fit.velocity_error_fit
    warnings = [] if fit.use is None else [*fit.use.warnings(dof)]
    if fit.use is not None and not fit.use.of_use and dof is YAW and all(SWAY.velocity in r.extras for r in fit.runs):
        warnings.append("A hull under way is turned as it drifts: `automarine fit-planar` fits surge and sway as well.")
    warnings += [f"Model {absent} could not be fitted: {reason}." for absent, reason in fit.refused.items()]
    noise = None
    if seed is not None:
        if fit.data is not None:  # else what pushes is no noise
            noise = float(np.median([run.noise for run in fit.used_runs if not run.summed_up] or [0.0]))
        if not seed.steady:
            tail, bias = dof.shown(seed.tail_from), 100 * np.abs(seed.expected.bias).max()
            warnings.append(
                f"{dof.words.reach.capitalize()} is too short for a steady speed: every tail is biased by more than "
                f"{100 * BIAS_LIMIT:.1f} %. The one from {tail:.0f} {dof.units.shown} on is biased by {bias:.1f} %, "
                "which was removed with a rough model. Trust the maximum likelihood, which needs no tail."
            )
    names = [turn.name for turn in fit.turns] or [run.name for run in fit.runs]
    warnings += fit_warnings(fit.output_error, preference, names, noise)
    grave = [c.sentence for c in cautions_of(fit) if c.grave or c.model in ("", preference.number)]
    return (*warnings, *grave)


def _needs_more(fit: OutputErrorFit) -> list[str]:
    """Say what the evidence would add to a model; nothing where it asks for nothing."""
    if not fit.proposed:
        return []
    asks = "; ".join(
        f"{name} ({effects.get(name).card(fit.model.dof).says.rstrip('.').lower()}) gains {gain:.0f} in deviance"
        for name, gain in fit.proposed.items()
    )
    names = ",".join(fit.proposed)
    return [f"The data need more than drag: {asks}. The intervals allow for it; fit it with --with {names}."]


def fit_warnings(
    fits: Mapping[str, OutputErrorFit], preference: Preference, names_of_runs: Sequence[str],
    position_noise: float | None = None,
) -> list[str]:  # fmt: skip
    """Sentences on the preferred maximum likelihood: implausible, resting on one run, late, or leaving more than the
    `position_noise` [rad] that the headings have by themselves."""
    fit = fits[preference.number]
    dof = fit.model.dof
    words, mark, base = dof.words, dof.units.mark, dof.units.base
    sentences = [*_needs_more(fit), *_one_run_that_decides(fit, names_of_runs)]
    if fit.gain_scatter.value > WILD_GAIN:
        gains = np.exp(fit.mixed.effects_of(GAIN)[:, 0])
        gains = gains / np.median(gains)
        odd = int(np.argmax(np.abs(np.log(gains))))
        sentences.append(
            f"The thrust seems to scatter by {100 * fit.gain_scatter.value:.0f} % from run to run, and "
            f"{names_of_runs[odd]} has {gains[odd]:.2g} times the gain of the others: check its {words.force} and its "
            "unit."
        )
    if position_noise and fit.noise and fit.noise > MIN_NOISE_RATIO * position_noise:
        sentences.append(
            f"Model {preference.number} leaves {dof.shown(fit.noise):.2g}{mark} of the {words.positions} "
            f"unexplained; they scatter by {dof.shown(position_noise):.2g}{mark} about smooth curves. An effect is "
            "missing, perhaps a delay: `automarine diagnose` looks for it."
        )
    turn = fit.inertial_turn_angle or (fits["3"].inertial_turn_angle if "3" in fits else None)
    low, high = dof.limits.plausible
    if turn is not None and not low <= turn.value <= high:
        sentences.append(
            f"The {words.inertial_length} of {turn.value:.3g} {base} lies outside {low:g} to {high:g} {base}, where "
            f"small vehicles are: check the units of time and {words.position}, and whether the thrusters or the log "
            "lag."
        )
    return sentences


def _one_run_that_decides(fit: OutputErrorFit, names_of_runs: Sequence[str]) -> list[str]:
    """A sentence where leaving one run out moves a parameter by more than all other runs together, and by much."""
    mixed = fit.mixed
    if len(names_of_runs) < 4:
        return []
    moved = (mixed.left_out - mixed.phi)[:, : len(fit.estimates)]
    total = np.maximum((moved**2).sum(axis=0), 1e-300)
    likely = np.sqrt(np.diagonal(mixed.covariance))[: len(fit.estimates)]
    decides = (moved**2 > MIN_DECIDING_SHARE * total) & (np.abs(moved) > MIN_MOVED_STDERRS * likely) & (likely > 0)
    if not decides.any():
        return []
    run, i = (int(k) for k in np.argwhere(decides)[0])
    name, estimate = list(fit.estimates.items())[i]
    without = np.exp(mixed.left_out[run, i]) if mixed.parameters.log[i] else mixed.left_out[run, i]
    changes = f"{name} of model {fit.number} from {without:.3g} to {estimate.value:.3g} {estimate.unit}"
    check = f"check its log, and whether its {fit.model.dof.words.position} jumps"
    return [f"{names_of_runs[run]} alone changes {changes}, more than all other runs together: {check}."]


LIKELIEST = ", maximum likelihood"
MEANINGS = {
    "surge.m_u": "mass with added mass, ahead", "sway.m_v": "mass with added mass, abeam",
    "yaw.I_r": "inertia with added inertia", "planar.m_vr": "inertia that couples sway and yaw",
    "surge.X_u": "linear drag ahead", "surge.X_uu": "quadratic drag ahead", "sway.Y_v": "linear drag abeam",
    "sway.Y_vv": "quadratic drag abeam", "yaw.k_r": "linear yaw drag", "yaw.k_rr": "quadratic yaw drag",
    "sway.Y_r": "sway force against turning", "yaw.N_v": "yaw moment against drifting",
    "yaw.N_ur": "yaw drag that grows with the speed ahead", "sway.Y_uv": "sway drag that grows with the speed ahead",
    "yaw.N_uv": "yaw moment against drifting, by the speed ahead",
    "sway.Y_ur": "sway force against turning, by the speed ahead",
    "current.north": "water, north", "current.east": "water, east",
}  # fmt: skip


def drag_table(fit: YawFit, notes: Sequence[str]) -> Table:
    """Table 1: drag of the three models and the sum of squares; intervals, tests and maximum likelihood below."""
    dof, sym, unit, ml = fit.dof, fit.dof.symbols, fit.moment_unit, fit.output_error
    seed = fit.velocity_error_fit
    drag = {} if seed is None else seed.drag
    quadratic, linear = sym.quadratic, sym.linear
    tests = {} if seed is None else {m: test["p_value"] for m in drag if (test := seed.test_against_2(m))}
    density = {m: number(float(of.mixed.predictive.sum()), 6) for m, of in ml.items()}
    rows = [
        *(_row(symbol, {m: e.value for m, e in _named(symbol, drag).items()}) for symbol in (quadratic, linear)),
        _row("SSE", {m: of.sse for m, of in drag.items()}),
        *(_row(f"{symbol}, 95 %", _named(symbol, drag)) for symbol in (quadratic, linear)),
        _row("AICc", {m: of.aicc for m, of in drag.items()}),
        _row("F test against 2, p", {m: number(p, 2) for m, p in tests.items()}),
        *(_row(f"{symbol}{LIKELIEST}", _named(symbol, ml)) for symbol in (quadratic, linear)),
        _row("log density of left-out runs", density),
    ]
    if dof.directional:
        ways = {m: of.ways for m, of in ml.items() if of.ways}
        rows += [_row(f"drag {way}{LIKELIEST}", {m: of.drag[way] for m, of in ways.items()}) for way in dof.words.ways]
        rows.append(_row("one drag both ways, p", {m: number(of.p_value, 2) for m, of in ways.items()}))
    if dof.biased:
        rows.append(_row(f"constant {dof.words.force}, 95 %", _named(sym.constant, drag)))
        rows.append(_row(f"constant {dof.words.force}{LIKELIEST}", _named(sym.constant, ml)))
        rows.append(_row(f"{sym.restoring} [{unit}]{LIKELIEST}", _named(sym.restoring, ml)))
    added = {m: _added(of) for m, of in ml.items()}
    units = {name: e.unit for of_model in added.values() for name, e in of_model.items()}
    for name, unit_of in units.items():
        rows.append(_row(f"{name} [{unit_of}]{LIKELIEST}", {m: of[name] for m, of in added.items() if name in of}))
    squared = f"({unit})²" if " " in unit else f"{unit}²"
    laws = ", ".join(f"{model} {law}" for model, law in DRAG_LAWS.items())
    of_units = (
        f"Drag of the models: {laws}. {dof.words.force.capitalize()} [{unit}], {quadratic} "
        f"[{dof.unit_of('quadratic', unit)}], {linear} [{dof.unit_of('linear', unit)}], SSE [{squared}] of the plain "
        "least squares; brackets are 95 % intervals."
    )
    title = f"Table 1. Identified {dof.name} models: drag"
    return Table.of(title, rows, (of_units, *_signs(dof), *notes), (3, 7)).without_empty_rows()


def _row(label: str, of_model: Mapping[str, object]) -> dict[str, object]:
    return {"Model": label} | {model: of_model.get(model) for model in DRAG_LAWS}


def _named(name: str, fits: Mapping[str, DragFit | OutputErrorFit]) -> dict[str, Estimate]:
    return {model: fit.estimates[name] for model, fit in fits.items() if name in fit.estimates}


def _added(fit: OutputErrorFit) -> dict[str, Estimate]:
    """Estimates of what is fitted of the effects beside drag, by effect and parameter."""
    fitted = dict[str, Estimate]()
    for name, group in effect_estimates(fit).items():
        parameters = zip(effects.get(name).names_in(fit.model.dof), effects.get(name).parameters)
        fitted |= {f"{name} {symbol}": group[symbol] for symbol, p in parameters if symbol in group and not p.held}
    return fitted


def _signs(dof: Dof) -> tuple[str, ...]:
    if dof.wraps:
        return ()
    (first, second), sym, force = dof.words.ways, dof.symbols, dof.words.force
    v, quadratic = sym.velocity, sym.quadratic
    constant = f"; the constant {force} is weight less buoyancy, positive {first}" if dof.has_constant else ""
    turned = f" + {sym.restoring} sin({sym.position})" if dof.restoring else ""
    signs = (
        f"{first.capitalize()} is positive. {sym.linear} and {quadratic} are positive where drag brakes, as in "
        f"{force} = {sym.inertia} d{v}/dt + {sym.linear} {v} + {quadratic} |{v}| {v}{turned}; Fossen's derivatives of "
        f"these names are their negatives. {sym.inertia} is {dof.words.full_inertia}{constant}."
    )
    ways = (
        f"The drag of one way is {sym.linear} in model 1, else {quadratic}. Where {first} and {second} do not differ "
        "(p above 0.05) they are fitted as one; where they do, the value above is their mean."
    )
    return (signs, ways) if dof.directional else (signs,)


SWING_LABELS = {
    "natural period [s]": "natural_period_s", "damped period [s]": "damped_period_s", "damping ratio": "damping_ratio",
    f"damping ratio at {AMPLITUDE_DEG:g} deg": AT_AMPLITUDE,
    "quadratic damping [1/rad]": "quadratic_damping_per_rad", "angle of rest [deg]": "rest_angle_deg",
    "GM/k² [1/m]": "GM_over_radius_of_gyration_squared_per_m", "GM [m]": "GM_m",
}  # fmt: skip


def inertia_table(fit: YawFit, notes: Sequence[str]) -> Table:
    """Table 2: inertia of the three models; maximum likelihood and inertial turn angle below."""
    dof, sym, unit, ml = fit.dof, fit.dof.symbols, fit.moment_unit, fit.output_error
    of_model = {} if fit.velocity_error_fit is None else fit.velocity_error_fit.inertia
    ratio = f"{sym.inertia}/{sym.quadratic} [{dof.units.base}]"
    rows = [
        _row(sym.inertia, {m: table.overall.value for m, table in of_model.items()}),
        _row(f"{sym.inertia}, 95 %", {m: table.overall for m, table in of_model.items()}),
        _row(f"{sym.inertia}{LIKELIEST}", _named(sym.inertia, ml)),
        _row(f"{ratio}{LIKELIEST}", {m: of.inertial_turn_angle for m, of in ml.items()}),
        _row(f"command delay [s]{LIKELIEST}", {m: of.delay for m, of in ml.items()}),
    ]
    for way in dof.words.ways if dof.directional else ():
        far = {m: of.ways.distance.get(way) for m, of in ml.items() if of.ways}
        rows.append(_row(f"{ratio} {way}{LIKELIEST}", far))
    swings = {m: swing for m in ml if (swing := fit.swing_of(m))}
    for label in SWING_LABELS if swings else ():
        rows.append(_row(f"{label}{LIKELIEST}", {m: swing[SWING_LABELS[label]] for m, swing in swings.items()}))
    of_units = f"{sym.inertia} [{dof.unit_of('inertia', unit)}]; brackets are 95 % intervals."
    title = f"Table 2. Identified {dof.name} models: {dof.words.inertia}"
    return Table.of(title, rows, (of_units, *notes), (1,)).without_empty_rows()


def tables(fit: YawFit) -> tuple[Table, Table]:
    """Make tables 1 and 2, each sentence that must be known of their parameters below one of them."""
    seed = fit.velocity_error_fit
    why = f"{fit.why_no_velocity_error}." if seed is None else seed.expected.sentence(fit.dof, seed.by_user)
    cautions = cautions_of(fit)
    drag = [caution.sentence for caution in cautions if set(DRAG_ROLES) & set(caution.parameters)]
    inertia = (caution.sentence for caution in cautions if INERTIA in caution.parameters)
    return drag_table(fit, (why, *drag)), inertia_table(fit, tuple(line for line in inertia if line not in drag))


def sentences(fit: YawFit) -> tuple[str, ...]:
    """Say what a person should read: the parameters, or that nobody should use them; choice, scatter, warnings."""
    preferred, mixed, dof, words = fit.preferred, fit.preferred.mixed, fit.dof, fit.dof.words
    symbols = dof.symbols
    main = (symbols.inertia, symbols.linear, symbols.quadratic)
    shown = {name: e for name, e in preferred.estimates.items() if name in main}
    shown |= _added(preferred)
    shown |= {"command delay": preferred.delay} if fit.is_late else {}
    values = ", ".join(_valued(name, e) for name, e in shown.items())
    model = f"{DRAG_LAWS[preferred.number]} drag (model {preferred.number})"
    if fit.nomoto is not None:
        model += f", steered by the rudder at {'logged' if fit.nomoto.speed else 'a constant'} speed,"
    if any(
        term.name == "rudder" and "surge" not in term.effect.needs_at(term.values) for term in preferred.model.terms
    ):
        model += ", with a rudder at a constant speed,"
    head = f"{dof.name.capitalize()}: {model} from {_carrying(fit)}: {values}."
    if fit.of_ratios:
        values = ", ".join(_valued(f"{name}/{symbols.inertia}", e) for name, e in fit.ratios.items())
        more = f"a run with a {words.force}, or --known {symbols.inertia}=VALUE, gives {words.inertia} and drag"
        head = f"{dof.name.capitalize()}: {values} ({model}, {_carrying(fit)} without a {words.force}; {more})."
    use = () if fit.use is None else (fit.use.sentence(dof),)
    heads = _swing_heads(fit, fit.swing, model, values) if fit.swing else [head]
    lines = [*heads, *use] if fit.use is None or fit.use.of_use else [*use, *heads]
    if fit.consistency is not None:
        lines += _disagreement(fit.consistency, dof)
    derived = {} if dof.restoring else {f"{symbols.inertia}/{symbols.quadratic}": preferred.inertial_turn_angle}
    derived |= {f"drag {way}": e for way, e in preferred.ways.drag.items()} if preferred.ways else {}
    if text := ", ".join(_valued(name, e) for name, e in derived.items() if e):
        lines.append(f"{text}.")
    units = {dof.parameter(role): dof.unit_of(role, fit.moment_unit) for role in (*EVERY_ROLE, "constant")}
    priors = tuple(known_sentences(fit.priors, units | {COMMAND_DELAY: "s"}, mixed.names))
    lines += [fit.preference.because, *([] if fit.of_ratios else priors)]
    if priors and fit.velocity_error_fit:
        lines.append("The velocity errors of the paper do not use it.")
    noise = f"{words.rate} noise {dof.shown(mixed.noise):.3g}{dof.units.mark}/s"
    if preferred.noise is not None:
        bound = " (at its bound)" if channel_noises(mixed, dof)[dof.position].at_bound else ""
        noise = f"{words.position} noise {dof.shown(preferred.noise):.2f}{dof.units.mark}{bound}"
    scatter = preferred.gain_scatter
    band = "(at its bound)" if scatter.at_bound else "[{:.1f}, {:.1f}]".format(*(100 * end for end in scatter.ci95))
    line = f"Thrust scatters from run to run by {100 * scatter.value:.1f} % {band}; {noise}."
    if not any(np.any(run.command) for run in fit.used_runs):
        line = f"{noise[0].upper()}{noise[1:]}."
    if mixed.driven:
        names = ("disturbance", "disturbance-time", "thrust-noise")
        size, time, thrust = (mixed.value(f"{dof.name}.{name}") for name in names)
        line += (
            f" The runs are disturbed by a {words.force} of {preferred.model.inertia * size:.3g} {fit.moment_unit} "
            f"that lasts {time:.2g} s, and the thrust is unsteady by {100 * thrust:.0f} % over a second."
        )
    lines += [line, *sensor_sentences(sensors_of(fit.channels, channel_noises(mixed, dof)), dof)]
    if fit.buoyancy is not None:
        lines.append(fit.buoyancy.says)
    lines += rudder_sentences(fit.nomoto)
    lines += [f"Read: {note}." for note in shared_readings(fit.used_runs)]
    warnings = fit.warnings if fit.use is None or fit.use.of_use else fit.warnings[1:]  # that line stands first
    return (*lines, *(f"Warning: {warning}" for warning in warnings))


def _swing_heads(fit: YawFit, swing: Swing, model: str, values: str) -> list[str]:
    """Say how the vehicle swings, and what the moments are or are over the inertia."""
    dof, sym = fit.dof, fit.dof.symbols
    first = {"natural period": swing["natural_period_s"], "damping ratio": swing["damping_ratio"],
             f"quadratic damping {sym.quadratic}/{sym.inertia}": swing["quadratic_damping_per_rad"]}  # fmt: skip
    more = {
        "Damped period": swing["damped_period_s"], f"damping ratio at {AMPLITUDE_DEG:g}°": swing[AT_AMPLITUDE],
        "angle of rest": swing["rest_angle_deg"],
        "GM/k² (k: radius of gyration)": swing["GM_over_radius_of_gyration_squared_per_m"], "GM": swing["GM_m"],
    }  # fmt: skip
    fixed = f", {sym.inertia} fixed at 1" if fit.of_ratios else ""
    texts = [", ".join(_valued(name, e).removesuffix(" 1") for name, e in part.items() if e) for part in (first, more)]
    because = f"decays alone show ratios: --known {sym.inertia}=VALUE gives moments"
    moments = f"Ratios to {sym.inertia} ({because})" if fit.of_ratios else "Moments"
    restoring = _valued(sym.restoring, fit.preferred.estimates[sym.restoring])
    head = f"{dof.name.capitalize()}: {texts[0]}; {model} from {_carrying(fit)}{fixed}."
    return [head, f"{texts[1]}.", f"{moments}: {values}, {restoring}."]


def rudder_sentences(nomoto: Nomoto | None) -> Iterator[str]:
    """Say how the vehicle answers its rudder."""
    if nomoto is None:
        return
    to = "starboard" if nomoto.side > 0 else "port"
    speed = "a constant speed" if nomoto.speed is None else f"{nomoto.speed:.3g} m/s"
    yield (
        f"The command is the rudder angle: at {speed} its N_delta is 1, drag and inertia are shares of it. Positive "
        f"rudder turns to {to}."
    )
    first = {"K": nomoto.gain, "T": nomoto.time, "N_delta/I_r": nomoto.effect, **nomoto.prime}
    yield f"Nomoto, T r' + r = K delta: {', '.join(_valued(name, e) for name, e in first.items())}."
    if nomoto.cubic:
        cubic = ", ".join(_valued(name, e) for name, e in nomoto.cubic.items())
        unstable = "; the hull is unstable on its course" if nomoto.n1 < 0 else ""
        yield f"Norrbin, T r' {'-' if nomoto.n1 < 0 else '+'} r + n3 r³ = K delta: {cubic}{unstable}."
    full, turning, fastest = np.rad2deg([nomoto.full, nomoto.turning, nomoto.fastest])
    yield f"The model turns at {turning:.3g}°/s under {full:.3g}° if its speed stays; the logs reach {fastest:.3g}°/s."
    if nomoto.overshoots:
        yield overshoot_sentence(nomoto.overshoots)


def overshoot_sentence(pairs: Sequence[tuple[float, float]]) -> str:
    """Say how overshoot angles [rad] of logs and of the model differ."""
    logged, modelled = np.rad2deg(np.mean(pairs, axis=0))
    return (
        f"Overshoot angles of {len(pairs)} swings are {logged:.3g}° on the mean in the logs and "
        f"{modelled:.3g}° by the model, which misses each by {np.rad2deg(mean_miss(pairs)):.2g}°."
    )


LOOK_FOR_EFFECT = "An effect is missing: look for it with `automarine diagnose`."
PUSHES = {
    STIRRED: "Something pushes the more, the longer and farther the vehicle {has_moved}, as water does that it stirs",
    FADING: "The thrust seems to fade along a step, the more the larger it is, as with a battery that sags",
}


def _carrying(fit: YawFit) -> str:
    """Name the data that carry the answer."""
    used, tests = len(fit.used_runs), fit.consistency
    count = f"{used} of {used + len(fit.set_aside)} runs"
    if fit.fitted_to.startswith("whole"):
        return f"whole runs ({count})"
    why = "; the rest disagrees, an effect is missing" if tests is not None and not tests.agrees else ""
    return f"first {fit.dof.words.step}s ({count}{why})" if fit.dof.wraps else count


def _disagreement(tests: Consistency, dof: Dof) -> Iterator[str]:
    """Say by what whole steps and their first half-turns were found to differ."""
    if tests.push:
        says = PUSHES[tests.push].format(has_moved=f"has {dof.words.moved}")
        yield f"{says} (p = {number(tests.p_push[tests.push], 1)}). The numbers allow for it. {LOOK_FOR_EFFECT}"
    if tests.agrees:
        return
    p_values = {
        f"{dof.words.inertia} or drag differ": (tests.p_parameters, MIN_P_PARAMETERS),
        f"the {dof.words.position} bends": (tests.p_bends, MIN_P_BENDS),
    }
    differs = [f"{text} (p = {number(p, 1)})" for text, (p, least) in p_values.items() if p < least]
    if tests.noisier:
        differs.append(f"{100 * (tests.noise_ratio - 1):.0f} % more noise is left")
    yield f"After the first {dof.words.step} {' and '.join(differs)}. {LOOK_FOR_EFFECT}"


def known_sentences(priors: Priors, units: Mapping[str, str], names: Iterable[str]) -> Iterator[str]:
    """Say what was known, in the `units` of the fit by qualified name, and what a model of these `names` lacks."""
    short = {name: name.partition(".")[2] or name for name in priors}
    if priors:
        values = (f"{short[name]} = {prior} {units.get(name, '')}".strip() for name, prior in priors.items())
        yield f"Known beforehand: {', '.join(values)}."
    if lacking := [short[name] for name in sorted({*priors} - {*names})]:
        yield f"The preferred model has no {' and no '.join(lacking)}; it was not used there."


def _valued(name: str, estimate: Estimate) -> str:
    return f"{name} {interval(estimate)} {estimate.unit}"


@sections.register
def _(fit: YawFit) -> Sections:
    model = f"{fit.dof.name}_model.json"
    files: dict[str, Content] = {model: fit.to_json()}
    both = tables(fit)
    for name, table in zip(("table1", "table2"), both):
        files |= forms_of(name, table)
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(run_rows(fit)), sink, compression="zstd")
    files["runs.parquet"] = sink.getvalue().to_pybytes()
    drawings = _drawings(fit)
    listed = (model, "table1 and table2 (.csv, .md, .tex)", "runs.parquet", *(f"{name}.png" for name in drawings))
    return Sections(sentences(fit), files, drawings, listed, tuple(_numbers(fit)), details=both)


def _drawings(fit: YawFit) -> dict[str, Drawing]:
    seed, data, use = fit.velocity_error_fit, fit.data, fit.use
    residuals = {"residuals": Drawing("parameters.residuals_figure", fit.preferred, fit.runs, data, use)}
    steady = {name: Drawing(f"runs.{name}_figure", fit, seed) for name in ("drag", "inertia") if seed}
    if data is not None:
        halves = {f"{fit.dof.step_key}s": Drawing("runs.half_turns_figure", fit)}
        return halves | steady | {"collapse": Drawing("runs.collapse_figure", fit, data)} | residuals
    if use is not None and fit.preferred.mixed.driven:
        noise = fit.preferred.noise or 0.0
        return {"whole_runs": Drawing("runs.driven_runs_figure", fit.runs, use, noise)} | steady | residuals
    return {"whole_runs": Drawing("runs.whole_runs_figure", fit)} | residuals


def _numbers(fit: YawFit) -> Iterator[dict[str, object]]:
    groups = {(m, "maximum likelihood"): {**of.estimates, **_added(of)} for m, of in fit.output_error.items()}
    if (seed := fit.velocity_error_fit) is not None:
        for model, drag in seed.drag.items():
            heavy = {fit.dof.symbols.inertia: seed.inertia[model].overall} if model in seed.inertia else {}
            groups[model, "velocity error"] = {**drag.estimates, **heavy}
    for (model, method), estimates in groups.items():
        for name, estimate in estimates.items():
            yield {"model": model, "method": method, "parameter": name} | numbers(estimate)


def run_rows(fit: YawFit) -> list[dict[str, object]]:
    """List what was kept of each run, and what both methods give of it."""
    dof, words, data, seed, use = fit.dof, fit.dof.words, fit.data, fit.velocity_error_fit, fit.use
    key, rate_key, mixed, rows = dof.units.shown, f"{dof.units.shown}_s", fit.preferred.mixed, list[dict[str, object]]()
    gains = np.exp(mixed.effects_of(GAIN)[:, 0]).tolist()
    if seed is None or data is None:
        for i, run in enumerate(fit.runs):
            row = {"run": run.name, "file": run.source, "samples": len(run), "duration_s": run.time[-1] - run.time[0]}
            if use is not None and mixed.driven:  # what was predicted of it when it was left out of the fit
                row["gain"] = gains[i]
                for ahead in use.predictions:
                    error = np.sqrt(ahead.by_run(len(fit.runs))[i])
                    row[f"rmse_{ahead.horizon:g}_s_ahead_{key}"] = float(dof.shown(error))
            else:
                off = dof.shown(run.position - mixed.reading(dof.position)[i][: len(run)])
                row[f"start_{words.speed}_{rate_key}"] = float(dof.shown(mixed.effects_of(START_VELOCITY)[i, 0]))
                row |= {"gain": gains[i], f"rmse_{key}": float(np.sqrt(np.mean(off**2)))}
            rows.append(row)
        return rows
    reading = mixed.reading(dof.position)
    for i, turn in enumerate(fit.turns):
        off = dof.shown((data.heading[i] - reading[i])[data.observed[i]])
        rows.append({
            "run": turn.name, "file": turn.step.run.source, words.force: turn.moment,
            "time_from_s": float(turn.time[0]), "time_to_s": float(turn.time[-1]), "samples": len(turn.time),
            f"{words.gone_key}_{key}": float(dof.shown(turn.turned)),
            f"start_{words.position}_{dof.units.log}": float(dof.logged(turn.start_position)),
            f"steady_{words.speed}_{rate_key}": float(dof.shown(seed.tails.rate[i])),
            f"steady_{words.speed}_stderr_{rate_key}": float(dof.shown(np.sqrt(seed.variance[i]))),
            f"velocity_error_{key}": float(dof.shown(seed.tails.error[i])),
            **{f"{dof.symbols.inertia}_model_{n}": float(table.per_run[i]) for n, table in seed.inertia.items()},
            "gain": gains[i], f"rmse_{key}": float(np.sqrt(np.mean(off**2))),
        })  # fmt: skip
    return rows


@sections.register
def _(fit: PlanarFit) -> Sections:
    warnings = [line for line in fit.warnings if line not in (*fit.of_logs, *fit.use.warnings(YAW))]
    grave = [f"Warning: {line}" for line in (*fit.of_logs, fit.use.large) if line]
    first = [fit.use.sentence(YAW), *grave, fit.fitted_because, *warnings]
    details = list(planar_sentences(fit))
    tables = [parameter_table(fit), prediction_table(fit.use), structure_table(fit)]
    rows = [{"parameter": name, **numbers(estimate)} for name, estimate in fit.estimates.items()]
    files = {"planar_model.json": fit.to_json()} | forms_of("planar", *tables)
    files |= {"planar.csv": Table.of("", rows).to_csv(), "planar.md": document(*tables, *first, *details)}
    noise = fit.best.mixed.noise_of.get(YAW.position, 0.0)
    drawings = {
        "planar_runs": Drawing("runs.driven_runs_figure", fit.runs, fit.use, noise),
        "planar_tracks": Drawing("runs.tracks_figure", fit),
        "residuals": Drawing("parameters.residuals_figure", fit.best, fit.runs, None, fit.use),
    }
    listed = "planar_model.json", "planar (.csv, .md, .tex)", *(f"{name}.png" for name in drawings)
    return Sections([*first, tables[0]], files, drawings, listed, rows, details=[*tables[1:], *details])


def planar_sentences(fit: PlanarFit) -> Iterator[str]:
    yield f"Structure: {fit.structure}. {fit.because}"
    yield f"Commands act {interval(fit.best.delay)} s after the middle of the sample interval in which they changed."
    units = {p.name: p.unit for p in fit.model.parameters()}
    yield from known_sentences(fit.priors, units, units)
    yield from (f"Assumed: {a}." for a in fit.observed.assumptions(fit.model) if a.parameter not in fit.estimates)
    noises = fit.best.mixed.noise_of
    channels = [f"{name} ({number(noises[name], 3)})" if name in noises else name for name in fit.observed.channels]
    yield f"Sensors used (noise in rad, m and seconds): {', '.join(channels)}."


def prediction_table(use: Judgement) -> Table:
    """One row a horizon and quantity: errors of the model beside those of whoever expects no change."""
    rows = [
        {"of": f"{name}, {unit_of_quantity(name, YAW)}"} | forecast_cells(ahead, YAW if name == YAW.position else None)
        for name, horizons in use.worth.items()
        for ahead in horizons
    ]
    source = "Each run is predicted by the parameters that the other runs give" if use.runs > 1 else "Of the run fitted"
    return Table.of("Predictions", rows, [
        f"Root mean square errors. {source}, from its filtered state, which knows the readings until then, by the "
        "commands as they were logged.",
    ])  # fmt: skip


def forecast_cells(ahead: ForecastScore, dof: Dof | None) -> dict[str, object]:
    """Give errors at a horizon as cells: of the model, and of whoever expects no change; positions of a `dof` in the
    unit that people see."""
    sizes = {"error": ahead.error, "constant rate": ahead.constant_rate, "constant": ahead.constant}
    errors = {word: number(float(dof.shown(size)) if dof else size, 3) for word, size in sizes.items()}
    return {"s ahead": f"{ahead.horizon:g}", **errors, "predictions": ahead.count}


def parameter_table(fit: PlanarFit) -> Table:
    meanings = dict(MEANINGS)
    for term in fit.model.terms:
        if not term.base:
            shown = term.effect.card(fit.model.motion.dofs[term.dof]).parameters
            meanings |= zip(fit.model.names_of(term), [parameter.meaning for parameter in shown])
    laws = [
        f"{fit.model.motion.dofs[term.dof].name}.{term.name}, {p.meaning}: {p.choices[round(value)]}."
        for term in fit.model.terms if not term.is_cross
        for p, value in zip(term.effect.parameters, term.values) if p.choices
    ]  # fmt: skip
    assumed = [a for a in fit.observed.assumptions(fit.model) if a.parameter in fit.estimates]
    meanings |= {a.parameter: f"{meanings.get(a.parameter, '')} (assumed)" for a in assumed}
    rows = [
        {"parameter": name, "meaning": meanings.get(name, ""), "value [95 % interval]": estimate, "unit": estimate.unit}
        for name, estimate in fit.estimates.items()
    ]
    return Table.of("Surge, sway and yaw together", rows, [
        "Masses and drags are positive where they resist, as in m_u u' = X - X_u u; Fossen's derivatives of these "
        "names are their negatives.",
        *laws,
        *(f"Assumed: {assumption}." for assumption in assumed),
    ])  # fmt: skip


def structure_table(fit: PlanarFit) -> Table:
    best = criterion(fit.tried[0])
    return Table.of("Structures", [
        {"structure": structure_of(t.model, fit.observed), "parameters": len(t.model.free),
         "log likelihood": number(t.mixed.log_likelihood, 7), "BIC less the best": criterion(t) - best}
        for t in fit.tried
    ])  # fmt: skip
