"""A whole yaw identification: which runs serve for what, both estimators, the preferred model, and what to
be warned of."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.fits.channel_noise import channels_json
from automarine_cli.fits.drag import nested_test
from automarine_cli.fits.driven_use import Judgement, Use
from automarine_cli.fits.innovations import InnovationsFit, random_estimates
from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.output_error import OutputErrorFit, Preference, estimate_of, run_dof
from automarine_cli.fits.step_response import StepData
from automarine_cli.fits.validity import covariance_json, valid_range
from automarine_cli.fits.velocity_error import VelocityErrorFit
from automarine_cli.fits.yaw_cautions import DRAG, Caution
from automarine_cli.models.store import model_json
from automarine_cli.pipeline.records import Document, json_document
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.channels import NOTHING_TO_CHOOSE, ChannelChoice
from automarine_cli.runs.half_turn import HalfTurn
from automarine_cli.runs.run import Run, SetAside

GRAVITY = 9.81  # m/s²; within 0.3 % of what it is anywhere


@dataclass(frozen=True, repr=False)
class YawFit(Shown):
    """Everything that a yaw identification found.

    `turns` and `data` are the half-turns used (empty and None for whole runs), `runs` the whole runs (or
    empty), `output_error` and `seed_method` the two estimators by model, `why_no_seed_method` a sentence
    where there is none; `cautions` are on single parameters, of which those that matter are `warnings` as well;
    `channels` are the sensors that count; `use` is what the model predicts, of whole runs; `known` is what was known
    beforehand.
    """

    moment_unit: str
    turns: tuple[HalfTurn, ...]
    data: StepData | None
    runs: tuple[Run, ...]
    output_error: Mapping[str, OutputErrorFit]
    seed_method: VelocityErrorFit | None
    why_no_seed_method: str
    preference: Preference
    set_aside: tuple[SetAside, ...]
    warnings: tuple[str, ...]
    cautions: tuple[Caution, ...]
    dof: Dof
    channels: ChannelChoice = NOTHING_TO_CHOOSE
    use: Judgement | None = None
    known: Known = NOTHING_KNOWN

    @property
    def preferred(self) -> OutputErrorFit:
        """The preferred model's maximum-likelihood fit."""
        return self.output_error[self.preference.number]

    @property
    def inertial_turn_angle(self) -> Estimate | None:
        """Inertia over quadratic drag of the preferred model; None where that has linear drag alone."""
        return self.preferred.inertial_turn_angle

    @property
    def time_constant(self) -> Estimate | None:
        """Inertia over linear drag [s] of model 1, where that is preferred."""
        fit, own = self.preferred, self.dof.symbols
        if fit.number != "1" or own.linear not in fit.estimates:
            return None
        found, direction = fit.mixed, np.zeros(len(fit.mixed.theta))
        at = [found.names.index(self.dof.parameter(role)) for role in ("inertia", "linear")]
        if not (found.theta[at] > 0).all() or set(at) & set(found.at_bound):
            return None
        direction[at] = np.where(found.positive[at], 1.0, 1.0 / found.theta[at]) * np.array([1.0, -1.0])
        stderr = float(np.sqrt(max(float(direction @ fit.covariance @ direction), 0.0)))
        value = fit.estimates[own.inertia].value / fit.estimates[own.linear].value
        return Estimate.from_log(value, stderr, run_dof(found, direction), "s")

    @property
    def used(self) -> int:
        """Number of runs fitted."""
        return len(self.turns) or len(self.runs)

    @property
    def read(self) -> Sequence[Run]:
        """The runs as they were read, for what is to be known of that."""
        return self.runs or [turn.step.run for turn in self.turns]

    @property
    def moments(self) -> tuple[float, ...]:
        """Every moment that was fitted, with its sign."""
        if self.turns:
            return tuple(turn.moment for turn in self.turns)
        return tuple(float(end) for run in self.runs for end in (run.command.min(), run.command.max()))

    def document(self, option: str) -> Document:
        """Its result file, for a command that takes a model."""
        return json_document(f"{self.dof.name}_model.json", self.to_json())

    def to_json(self) -> dict[str, object]:
        """The result file: schema automarine/yaw-model/1, or that of another motion."""
        fit, turn, dof = self.preferred, self.inertial_turn_angle, self.dof
        return {
            **model_json(
                dof, unit=self.moment_unit, fitted_to=f"{dof.words.step}s" if self.turns else "whole runs",
                models={number: self._model_json(number) for number in sorted(self.output_error)},
                preferred=self.preference.number, because=self.preference.because,
                ratio=None if turn is None else turn.to_json(), valid_range=valid_range(self.moments, fit.model),
                effects=_effects_json(fit),
            ),
            **self._driven_json(),
            **({} if self.time_constant is None else {"time_constant_s": self.time_constant.to_json()}),
            "gain_scatter": fit.gain_scatter.to_json(),
            "switch_offset": fit.offset.to_json(),
            f"{dof.words.position}_noise_{dof.units.key}": None
            if fit.noise is None
            else float(dof.shown(fit.noise)),
            **channels_json(self.channels, fit.mixed, dof),
            **({"buoyancy": self.buoyancy.to_json()} if self.buoyancy else {}),
            "warnings": list(self.warnings),
            "runs": runs_json(self.used, self.set_aside, self.read),
        }  # fmt: skip

    @property
    def told_of_known(self) -> tuple[str, ...]:
        """What was known beforehand, in sentences."""
        dof = self.dof
        units = {dof.parameter(role): dof.unit_of(role, self.moment_unit) for role in ("inertia", *DRAG, "constant")}
        found = self.known.sentences(units, self.preferred.mixed.names)
        paper = ("The velocity errors of the paper do not use it.",) if found and self.seed_method else ()
        return (*found, *paper)

    @property
    def buoyancy(self) -> "Buoyancy | None":
        """The constant force of the preferred model; None for motions without one."""
        return Buoyancy(self.preferred.estimates[self.dof.symbols.constant]) if self.dof.has_constant else None

    def _driven_json(self) -> dict[str, object]:
        """What only whole runs have: what the model predicts of runs left out, and of driven ones what is random."""
        found, use = self.preferred.mixed, self.use
        if use is None:
            return {}
        random: dict[str, object] = {}
        if isinstance(found, InnovationsFit):
            random = {"driven": True, "random": random_estimates(found, self.preferred.covariance, self.dof)}
        if isinstance(use, Use):
            random["proposed"] = dict(use.proposed)
        return {
            **random,
            "prediction": {
                "left_out_runs": [one.to_json(self.dof) for one in use.worth],
                "of_use": use.of_use,
                "says": use.sentence(self.dof),
            },
        }

    def _model_json(self, number: str) -> dict[str, object]:
        fit, dof = self.output_error[number], self.dof
        estimates = {name: e.to_json() for name, e in _drag_first(fit.estimates, dof).items()}
        content: dict[str, object] = dict(estimates)
        content[dof.ratio_key] = None if fit.inertial_turn_angle is None else fit.inertial_turn_angle.to_json()
        content["output_error"] = {
            **estimates,
            "log_likelihood": fit.mixed.log_likelihood,
            "log_density_of_left_out_runs": float(fit.mixed.predictive.sum()),
            "gain_scatter": fit.gain_scatter.to_json(),
            "switch_offset": fit.offset.to_json(),
            f"{dof.words.position}_noise_{dof.units.key}": None if fit.noise is None else float(dof.shown(fit.noise)),
            "covariance": covariance_json(list(fit.estimates), fit.mixed.theta, fit.mixed.positive, fit.covariance),
            "converged": fit.mixed.converged,
            **({"estimator": fit.estimator} if fit.estimator else {}),
        }
        if own := _effects_json(fit):
            content["effects"] = own
        if fit.ways is not None:
            content["sides"] = fit.ways.to_json()
        seed = self.seed_method
        if seed is None or number not in seed.drag:
            why = self.why_no_seed_method or f"too few {dof.words.step}s for two drag terms"
            return content | {"sse": None, "velocity_error": None, "why": why}
        drag, table = seed.drag[number], seed.inertia.get(number)
        if table is None:
            content["why"] = (
                f"the drag of the least squares leaves no steady {dof.words.speed}, so no velocity error gives "
                f"{dof.words.an_inertia}"
            )
        content["sse"] = drag.sse
        content["velocity_error"] = {
            **{name: e.to_json() for name, e in drag.estimates.items()},
            dof.symbols.inertia: None if table is None else table.overall.to_json(),
            "sse": drag.sse,
            "aicc": drag.aicc if np.isfinite(drag.aicc) else None,
            "f_test_against_2": asdict(nested_test(drag, seed.drag["2"]))
            if number != "2" and "2" in seed.drag
            else None,
            f"{dof.symbols.inertia}_mean_at_{dof.words.force}": {
                f"{level:g}": mean for level, mean in (table.per_moment if table else {}).items()
            },
            "dilution_taken_off": dict(drag.dilution),
            f"tail_from_{dof.units.key}": float(dof.shown(seed.tail_from)),
            "tail_because": seed.tail_because(dof),
            "tail_expected": seed.expected.to_json(dof),
        }
        return content


def _effects_json(fit: OutputErrorFit) -> list[dict[str, object]]:
    """The effects beside drag that a fit was asked to have, as an extended model holds them."""
    return [
        {"name": effect, "parameters": {name: one.to_json() for name, one in own.items()}}
        for effect, own in effect_estimates(fit).items()
    ]


def effect_estimates(fit: OutputErrorFit) -> dict[str, dict[str, Estimate]]:
    """Estimates of the effects beside drag that a fit was asked to have, by effect and parameter; standard errors of
    zero are of what is not fitted."""
    found, model = {}, fit.model
    for term in model.terms:
        if term.own:
            continue
        names = effects.get(term.name).names_in(model.dof)
        card = effects.get(term.name).card(model.dof, model.moment_unit)
        found[term.name] = {
            name: estimate_of(fit.mixed, fit.covariance, model.index(f"{term.name}.{name}"), parameter.unit)
            for name, parameter in zip(names, card.parameters)
        }
    return found


def _drag_first(estimates: Mapping[str, Estimate], dof: Dof) -> dict[str, Estimate]:
    own = dof.symbols
    order = (own.quadratic, own.linear, own.inertia, own.constant, own.difference)
    return {name: estimates[name] for name in order if name in estimates}


@dataclass(frozen=True)
class Buoyancy:
    """The constant force of a model, positive down, told as what a diver would do about it."""

    force: Estimate

    @property
    def ballast(self) -> Estimate | None:
        """Mass [kg], weighed in water, that balances the vehicle; None for a normalised force."""
        if self.force.unit != "N":
            return None
        low, high = self.force.ci95
        return Estimate(
            -self.force.value / GRAVITY, self.force.stderr / GRAVITY, (-high / GRAVITY, -low / GRAVITY), "kg"
        )

    @property
    def says(self) -> str:
        """One sentence."""
        low, high = self.force.ci95
        force = f"{abs(self.force.value):.3g} {self.force.unit}"
        if low < 0 < high:
            return f"Buoyancy: not significant; the force is {low:.2g} to {high:.2g} {self.force.unit} down."
        up = self.force.value < 0
        sure = sorted((abs(low), abs(high)))
        text = f"Buoyancy: a constant force of {force} [{sure[0]:.3g}, {sure[1]:.3g}] {'up' if up else 'down'}"
        if self.ballast is None:
            return f"{text}, in the unit of the command."
        mass, ends = abs(self.ballast.value), [one / GRAVITY for one in sure]
        what = "add" if up else "take off"
        kilograms = f"{mass:.3g} kg [{ends[0]:.3g}, {ends[1]:.3g}]"
        return f"{text}: to balance it {what} {kilograms} of ballast, weighed in water."

    def to_json(self) -> dict[str, object]:
        """For the result file."""
        ballast = self.ballast
        return {
            "constant_force": self.force.to_json(),
            "ballast_in_water": None if ballast is None else ballast.to_json(),
            "says": self.says,
        }
