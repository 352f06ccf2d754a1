"""What a user knows before the fit: values of parameters."""

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.models.model import COMMAND_DELAY
from automarine_cli.models.parameter import Prior
from automarine_cli.text import MAX_NAME_LETTERS

EXAMPLE = "I_r=915 or I_r=915±50"
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_KNOWN = re.compile(rf"\s*([^\s=]+)\s*=\s*({_NUMBER})\s*(?:(?:±|\+/?-)\s*({_NUMBER})\s*)?")


@dataclass(frozen=True)
class Known:
    """What need not be estimated: `parameters` by name, as users write them (I_r, sway.Y_v)."""

    parameters: Mapping[str, Prior] = field(default_factory=dict)

    @classmethod
    def of(cls, prior: object) -> "Known":
        """The record of what Python, the command line or a campaign file gives: a record, texts such as "I_r=915±50",
        or a mapping {"I_r": 915} or {"I_r": (915, 50)}. Raises SettingError for what is none of these."""
        if isinstance(prior, Known):
            return prior
        if isinstance(prior, Mapping):
            return cls(parameters={str(name): _prior(str(name), value) for name, value in prior.items()})
        texts = [prior] if isinstance(prior, str) else prior
        if not isinstance(texts, Iterable):
            raise SettingError(f"known is {prior!r}; expected a value by name, such as {EXAMPLE}")
        parameters: dict[str, Prior] = {}
        for text in (part for entry in texts for part in str(entry).split(",") if part.strip()):
            match = _KNOWN.fullmatch(text)
            if match is None:
                raise SettingError(
                    f"known is {text.strip()!r}; expected a name, a number and perhaps its standard error, in the unit "
                    f"of the fit, such as {EXAMPLE}"
                )
            name, value, stderr = match.groups()
            if name in parameters:
                raise SettingError(f"known: {name} is given twice; give it once")
            parameters[name] = _prior(name, value if stderr is None else (value, stderr))
        return cls(parameters=parameters)

    def named(self, names: Mapping[str, str], signed: Sequence[str] = ()) -> "Known":
        """The same by the qualified names of a fit, `names` by what users may write; those of `signed` may have either
        sign. Raises SettingError for another name, or a value that no vehicle has."""
        priors: dict[str, Prior] = {}
        for name, prior in self.parameters.items():
            qualified = name if name in names.values() else names.get(name)
            if qualified is None:
                close = difflib.get_close_matches(name[:MAX_NAME_LETTERS], names, n=1)
                hint = f"; did you mean {close[0]}?" if close else ""
                raise SettingError(f"known: {name!r} is no parameter of this fit; it has {', '.join(names)}{hint}")
            if qualified in priors:
                raise SettingError(f"known: {name} is given twice; give it once")
            if qualified not in signed and prior.value <= 0:
                raise SettingError(f"known: {name} is {prior.value:g}; expected a number above 0")
            priors[qualified] = prior
        return replace(self, parameters=priors)

    def sentences(self, units: Mapping[str, str], names: Iterable[str]) -> tuple[str, ...]:
        """What was known, in the `units` of the fit by qualified name, and what a model of these `names` lacks."""
        if not self.parameters:
            return ()
        values = (
            f"{name.partition('.')[2] or name} = {p} {units.get(name, '')}" for name, p in self.parameters.items()
        )
        lacking = [name.partition(".")[2] or name for name in sorted(set(self.parameters) - set(names))]
        more = (f"The preferred model has no {' and no '.join(lacking)}; it was not used there.",) if lacking else ()
        return (f"Known beforehand: {', '.join(text.strip() for text in values)}.", *more)


NOTHING_KNOWN = Known()


def _prior(name: str, entry: object) -> Prior:
    parts = entry if isinstance(entry, Sequence) and not isinstance(entry, str) else (entry,)
    try:
        value, *stderr = (float(str(part)) for part in parts)
    except ValueError:
        value, stderr = math.nan, []
    if len(stderr) > 1 or not all(map(math.isfinite, (value, *stderr))) or min(stderr, default=1.0) <= 0:
        expected = "expected a finite number, or one and its standard error above 0, in the unit of the fit"
        raise SettingError(f"known: {name} is {entry!r}; {expected}")
    return Prior(value, *stderr)


def names_in(dof: Dof, effects: Iterable[str] = ()) -> dict[str, str]:
    """Qualified names of the parameters of one motion's fits, by what users write; `effects` are those beside drag."""
    roles = (
        "inertia",
        "linear",
        "quadratic",
        *(["constant"] if dof.biased else []),
        *(["restoring"] if dof.restoring else []),
    )
    names = {dof.parameters[role]: dof.parameter(role) for role in roles} | {name: name for name in effects}
    return names | {COMMAND_DELAY: COMMAND_DELAY}
