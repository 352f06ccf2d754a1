"""Model files, which people write too: models of one motion, of the plane, and thruster maps.

A key that means nothing is refused: it may be meant as one that is read. `unread` are those that may be there beside.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import keyed, told
from automarine_cli.results.estimate import Given
from automarine_cli.results.records import Covariance, ResultRecord, Sensor


@dataclass(frozen=True)
class Likeliest:
    """What the fit by maximum likelihood says beside its parameters."""

    covariance: Covariance | None = None


@dataclass(frozen=True)
class AddedEffect:
    """An effect of a model, parameters by name."""

    unread: ClassVar[tuple[str, ...]] = ("says", "confidence", "p_value", "rivals")
    name: str
    parameters: Mapping[str, Given]


@dataclass(frozen=True, kw_only=True)
class ModelEntry:
    """One of the models of a file; None is what it does not have."""

    unread: ClassVar[tuple[str, ...]] = ("velocity_error", "sse", "why", "sides", "warnings", "notes")
    inertia: Given | None = field(default=None, metadata=keyed("{inertia_symbol}"))
    quadratic: Given | None = field(default=None, metadata=keyed("{quadratic}"))
    linear: Given | None = field(default=None, metadata=keyed("{linear}"))
    constant: Given | None = field(default=None, metadata=keyed("{constant}"))
    difference: Given | None = field(default=None, metadata=keyed("{difference}"))
    ratio: Given | None = field(default=None, metadata=keyed("{ratio_key}"))
    output_error: Likeliest | None = None
    effects: tuple[AddedEffect, ...] | None = None


@dataclass(frozen=True)
class ValidRange:
    """Smallest and largest force and velocity of what was fitted."""

    force: tuple[float, float] | None = field(default=None, metadata=keyed("{force}"))
    velocity: tuple[float, float] | None = field(default=None, metadata=keyed("{velocity_key}"))


@dataclass(frozen=True)
class Parent:
    """The file that a model grew from."""

    file: str
    sha256: str


@dataclass(frozen=True)
class Said:
    """A part of a result of which the sentence is read."""

    says: str


@dataclass(frozen=True)
class Use:
    """Whether a model predicts better than somebody who expects no change, and the sentences that say so."""

    of_use: bool = True
    says: tuple[str, ...] | str = ()

    @property
    def refusal(self) -> str:
        """Why the model is not to be used; empty where it is of use."""
        said = (self.says,) if isinstance(self.says, str) else self.says
        return "" if self.of_use or not said else said[0]


@dataclass(frozen=True, kw_only=True)
class ModelFile(ResultRecord):
    """`yaw_model.json`, or that of another motion: models by number."""

    unread: ClassVar[tuple[str, ...]] = ("notes", "fitted_to", "driven", "time_constant_s")
    models: Mapping[str, ModelEntry | None]
    preferred: str
    force_unit: str | None = field(default=None, metadata=keyed("{force}_unit"))
    switch_offset: Given | None = None
    effects: tuple[AddedEffect, ...] = ()
    preferred_because: str = ""
    ratio: Given | None = field(default=None, metadata=keyed("{ratio_key}"))
    gain_scatter: Given | None = None
    gain_exponent: Given | None = None
    noise: float | None = field(default=None, metadata=keyed("{position}_noise_{shown_unit}"))
    valid_range: ValidRange | None = None
    parent: Parent | None = None
    channels: tuple[Sensor, ...] = ()
    random: Mapping[str, Given] = field(default_factory=dict)
    proposed: Mapping[str, float] = field(default_factory=dict)
    buoyancy: Said | None = None
    prediction: Use = field(default_factory=Use)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        there = [number for number, entry in self.models.items() if entry is not None]
        if not there:
            raise SettingError("models: holds no model; expected one or more of 1, 2, 3")
        if self.preferred not in there:
            raise SettingError(
                f"preferred: found {told(self.preferred)}, expected one of the file's models ({', '.join(there)})"
            )

    @property
    def chosen(self) -> ModelEntry:
        """The preferred model."""
        return self.models[self.preferred] or ModelEntry()

    def main_parameters(self) -> Iterator[tuple[str, Given]]:
        """Drag and inertia of the preferred model that it has, in letters for print."""
        own, entry = self.dof.symbols, self.chosen
        found = {own.quadratic_print: entry.quadratic, own.linear: entry.linear, own.inertia: entry.inertia}
        return ((name, given) for name, given in found.items() if given is not None)


@dataclass(frozen=True, kw_only=True)
class PlanarFile(ResultRecord):
    """`planar_model.json`: parameters by qualified name."""

    unread: ClassVar[tuple[str, ...]] = (
        "fitted_to", "assumptions", "valid_range", "channels", "disturbance", "noises", "log_likelihood",
        "structure_because", "estimated", "estimated_because", "effects", "predicts", "parent", "notes",
    )  # fmt: skip
    force_unit: str = "N"
    moment_unit: str = "N m"
    parameters: Mapping[str, Given]
    structure: str = ""
    covariance: Covariance | None = None
    random: Mapping[str, float] = field(default_factory=dict)
    prediction: Use = field(default_factory=Use)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class SquareLaw:
    """The square law of one direction; None where it was not measured."""

    a: Given | None = None


@dataclass(frozen=True)
class CurveEntry:
    """The parameters of one direction's curve."""

    unread: ClassVar[tuple[str, ...]] = ()
    a: Given | None = None
    p: Given | None = None
    n_0: Given | None = None
    n_sat: Given | None = None

    @property
    def named(self) -> dict[str, Given]:
        """Those that there are, by name."""
        return {name: one for name, one in vars(self).items() if one is not None}


@dataclass(frozen=True)
class Curves:
    """Both directions."""

    unread: ClassVar[tuple[str, ...]] = ()
    forward: CurveEntry | None = None
    backward: CurveEntry | None = None


@dataclass(frozen=True)
class FormEntry:
    """A form of the curve, and how well it fits."""

    form: str = ""
    equation: str = ""
    r2: float | None = None
    rmse_percent_of_full_scale: float | None = None


@dataclass(frozen=True)
class VoltagePower:
    """How the thrust of one direction grows with the voltage."""

    thrust_at_fixed_n: Given | None = None


@dataclass(frozen=True, kw_only=True)
class ThrusterFile(ResultRecord):
    """`thrusters.json`: a thruster map."""

    unread: ClassVar[tuple[str, ...]] = (
        "per_test", "r2", "rmse_N", "rmse_all_points_N", "cv_rmse_N", "chosen_because", "tare", "flagged",
        "voltages", "notes", "points", "by",
    )  # fmt: skip
    forward: SquareLaw
    backward: SquareLaw
    form: str
    parameters: Curves
    n_unit: str = ""
    n_range: tuple[float, float] | None = None
    full_scale_N: float | None = None
    rmse_percent_of_full_scale: float | None = None
    forms: tuple[FormEntry, ...] = ()
    chosen: FormEntry | None = None
    thrusters_per_test: int | None = None
    voltage_range_V: tuple[float, float] | None = None
    voltage_exponent: Mapping[str, VoltagePower | float | None] = field(default_factory=dict)
