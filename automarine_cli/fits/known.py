"""What a user knows before the fit: values of parameters, by name."""

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence

from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.models.model import COMMAND_DELAY, base_roles
from automarine_cli.models.parameter import Prior
from automarine_cli.text import MAX_NAME_LETTERS

EXAMPLE = "I_r=915 or I_r=915±50"
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_KNOWN = re.compile(rf"\s*([^\s=]+)\s*=\s*({_NUMBER})\s*(?:(?:±|\+/?-)\s*({_NUMBER})\s*)?")


def parse_known(known: object) -> dict[str, Prior]:
    """Read what Python, the command line or a campaign file gives, as users write names (I_r, sway.Y_v): texts such as
    "I_r=915±50", or a mapping {"I_r": 915} or {"I_r": (915, 50)}. Raises SettingError for what is none of these."""
    if isinstance(known, Mapping):
        return {str(name): _prior(str(name), value) for name, value in known.items()}
    texts = [known] if isinstance(known, str) else known
    if not isinstance(texts, Iterable):
        raise SettingError(f"known is {known!r}; expected a value by name, such as {EXAMPLE}")
    priors: dict[str, Prior] = {}
    for text in (part for entry in texts for part in str(entry).split(",") if part.strip()):
        match = _KNOWN.fullmatch(text)
        if match is None:
            raise SettingError(
                f"known is {text.strip()!r}; expected a name, a number and perhaps its standard error, in the unit "
                f"of the fit, such as {EXAMPLE}"
            )
        name, value, stderr = match.groups()
        if name in priors:
            raise SettingError(f"known: {name} is given twice; give it once")
        priors[name] = _prior(name, value if stderr is None else (value, stderr))
    return priors


def qualified(short: Mapping[str, Prior], names: Mapping[str, str], signed: Sequence[str] = ()) -> dict[str, Prior]:
    """Return the same by the qualified names of a fit, `names` by what users may write; those of `signed` may have
    either sign. Raises SettingError for another name, or a value that no vehicle has."""
    priors: dict[str, Prior] = {}
    for name, prior in short.items():
        of_fit = name if name in names.values() else names.get(name)
        if of_fit is None:
            close = difflib.get_close_matches(name[:MAX_NAME_LETTERS], names, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            raise SettingError(f"known: {name!r} is no parameter of this fit; it has {', '.join(names)}{hint}")
        if of_fit in priors:
            raise SettingError(f"known: {name} is given twice; give it once")
        if of_fit not in signed and prior.value <= 0:
            raise SettingError(f"known: {name} is {prior.value:g}; expected a number above 0")
        priors[of_fit] = prior
    return priors


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
    names = {dof.parameters[role]: dof.parameter(role) for role in base_roles("2", dof)} | {
        name: name for name in effects
    }
    return names | {COMMAND_DELAY: COMMAND_DELAY}
