"""The cases of `make blind`, what a user brings to each, and one word on a verdict.

Of a campaign with one or two effects hidden: `right` names just these; `tie` names all of them, each itself or as a
rival, or names another beside them; `wrong` names something else and does not list them; `missed` names nothing;
`suspected` lists something and does not name it; `learned` names a curve over a variable, of a law that the library
lacks; and `unexplained`. Where nothing is hidden, `right` names nothing and `false` anything.
"""

from typing import Any

from blind_cases import LAWS, PAIRS, STRANGE, Campaign, Case

from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import YawModel

SCATTERS = (0.0, 0.02, 0.03, 0.05)


def kind_of(case: Case) -> str:
    """Which row of the table a case counts in."""
    if not case.hidden:
        return "none"
    if any(law in STRANGE for law in case.hidden):
        return "strange"
    return "two" if len(case.hidden) == 2 else f"one, {case.layout}"


def guess(case: Case, campaign: Campaign) -> YawModel:
    """The base model that a user would bring: the right form, values some tenths off."""
    vehicle = campaign.vehicle
    unit = campaign.runs[0].moment_unit
    if "quadratic" in case.hidden:
        return YawModel.base("1", 1.2 * vehicle.inertia * vehicle.scale, [vehicle.linear * vehicle.scale], unit, YAW)
    return YawModel.base(
        "3", 1.2 * vehicle.inertia * vehicle.scale, [0.85 * vehicle.quadratic * vehicle.scale], unit, YAW
    )


def judge(case: Case, verdict: str, named: dict[str, list[str]]) -> str:
    """One word on a verdict; see the module's docstring."""
    if verdict == "suspected":
        return verdict
    if not case.hidden or any(law in STRANGE for law in case.hidden):
        right = "nothing-missing" if not case.hidden else "unexplained"
        if verdict == "named" and case.hidden and all(name.startswith("learned:") for name in named):
            return "learned"
        if verdict == "named":
            return "tie" if case.hidden and all(named.values()) else "false"
        return "right" if verdict == right else verdict
    if verdict == "nothing-missing":
        return "missed"
    if verdict == "unexplained":
        return "unexplained"
    truth = {LAWS[law][0] for law in case.hidden}
    if set(named) == truth:
        return "right"
    mentioned = set(named) | {rival for rivals in named.values() for rival in rivals}
    if truth <= mentioned:
        return "tie"
    return "half" if truth & mentioned and len(truth) == 2 else "wrong"


def all_cases(seeds: int, quick: bool) -> list[Case]:
    """Every effect by size, layout and seed, none hidden, two, and strange ones; --quick is 40 of them."""
    cases = []
    for seed in range(seeds):
        for number, law in enumerate(LAWS):
            for size in ("large",) if quick else ("small", "large"):
                for layout in (("full", "steps")[number % 2 :][:1]) if quick else ("steps", "full"):
                    cases.append(Case((law,), size, layout, seed))
        for number, scatter in enumerate(SCATTERS):
            for layout in (("full", "steps")[number % 2 :][:1]) if quick else ("steps", "full"):
                cases.append(Case((), f"scatter-{scatter:g}", layout, seed, scatter=scatter))
        cases += [Case(pair, "large", "full", seed) for pair in (PAIRS[:4] if quick else PAIRS)]
        cases += [Case((law,), "large", "full", seed) for law in STRANGE]
    if not quick:
        cases += [Case((law,), "usual", "full", seed, runs=48) for seed in range(seeds) for law in LAWS]
    return cases


def short_cases(seeds: int, noisy: bool) -> list[Case]:
    """One law of each of 21 effects, with manoeuvres or `noisy` steps alone; two effects; nothing hidden."""
    first = {name: law for law, (name, *_) in reversed(LAWS.items())}
    one = [law for law in LAWS if law in first.values()][:21]
    scatter, noise = (0.05, 2.0) if noisy else (None, None)
    layout = "steps" if noisy else "full"
    return [
        Case(hidden, "large" if hidden else "short", layout, seed, scatter=scatter, noise=noise)
        for seed in range(seeds)
        for hidden in [*((law,) for law in one), *PAIRS[:3], ()]
    ]


CLEAN: dict[str, dict[str, Any]] = {
    "72 runs": {"layout": "steps", "runs": 72, "scatter": 0.03, "noise": 1.0},
    "24 noisy runs": {"layout": "steps", "scatter": 0.05, "noise": 2.0},
    "manoeuvres": {"layout": "full", "scatter": 0.03, "noise": 1.0},
}
DRIVEN = "driven"


def clean_cases(seeds: int) -> list[Case]:
    """Nothing hidden: so many campaigns of each of four kinds, the driven ones those of the closed loop."""
    return [
        Case((), kind, **{"layout": DRIVEN, "seed": seed, **CLEAN.get(kind, {})})
        for seed in range(seeds)
        for kind in (*CLEAN, DRIVEN)
    ]
