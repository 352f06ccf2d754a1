"""What an axis of motion is: names, units, limits, and the words in which its results are told."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, pi
from typing import Any

from automarine_cli.quantities import unit_of


@dataclass(frozen=True)
class Axis:
    """One motion: a position, and the moment or force that drives it.

    `position`, `rate` and `command` are canonical quantities of the logs, `thrusters` the commands of which a map
    makes moment or force, each counting by `sides`; `levered` where that takes a lever arm. `turn` is after how much
    the position wraps [rad or m]. A position is logged in `log_unit` (`log_scale` of them are one of arithmetic's) and
    shown to people in `unit` (`scale`). `trim` is how far a step is followed unless asked otherwise, `least` what it
    has to cover before its end, `still` what counts as not having moved, `start` what counts as its beginning;
    `plausible` are inertial turn angles, or distances, of small vehicles. `constant`: a constant force is part of
    every model; `sided`: drag may differ between the two `ways`, the positive one first. `keys` and `words` are what
    result files and people call what yaw calls otherwise.
    """

    name: str
    position: str
    rate: str
    command: str
    units: tuple[str, ...]
    thrusters: tuple[str, ...]
    sides: tuple[float, ...]
    levered: bool
    turn: float
    scale: float
    unit: str
    log_scale: float
    log_unit: str
    trim: float
    least: float
    still: float
    start: float
    plausible: tuple[float, float]
    ways: tuple[str, str]
    constant: bool = False
    sided: bool = False
    keys: Mapping[str, str] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Any, ...]:
        return _axis_of, (self.name,)

    @property
    def wraps(self) -> bool:
        """Whether the position comes back to itself."""
        return self.turn < inf

    def shown(self, position: Any) -> Any:
        """A position or rate in the unit in which people see it."""
        return position * self.scale

    def logged(self, position: Any) -> Any:
        """A position or rate in the unit in which logs hold it."""
        return position * self.log_scale

    def inner(self, logged: Any) -> Any:
        """A position or rate as logs hold it in the unit of all arithmetic."""
        return logged * (pi / 180) if self.wraps else logged

    def say(self, text: str) -> str:
        """A sentence about yaw in the words of this motion."""
        return self._said.sub(lambda found: self._own[found[0]], text) if self.words else text

    def equation(self, text: str) -> str:
        """An equation of yaw in the letters of this motion."""
        if not self.words:
            return text
        named = re.sub(r"\b(?:k_r+|I_r|psi)\b", lambda found: self.say(found[0]), text)
        return re.sub(r"(?<![a-zA-Z_])r(?![a-zA-Z_])", self.words["k_r"][-1], self.say(named))

    def key(self, name: str) -> str:
        """A key of yaw's result files as this motion has it."""
        return self.keys.get(name, name)

    def named(self, content: Any) -> Any:
        """Content of a result file under this motion's keys."""
        return renamed(content, self.keys)

    def plain(self, content: Any) -> Any:
        """Content of this motion's file under yaw's keys."""
        return renamed(content, {own: key for key, own in reversed(list(self.keys.items()))})

    def misnamed(self, content: Any) -> str:
        """A key of yaw in this motion's file, however deep, that it calls otherwise; none: nothing."""
        if isinstance(content, Mapping):
            wrong = next((str(key) for key in content if self.keys.get(key, key) != key), "")
            return wrong or next(filter(None, map(self.misnamed, content.values())), "")
        if isinstance(content, list | tuple):
            return next(filter(None, map(self.misnamed, content)), "")
        return ""

    def unit_of(self, parameter: str, command_unit: str = "nu") -> str:
        """Unit of a parameter (`k_r`, `k_rr`, `k_rrr`, `I_r`, `tau`, `theta_c`, `b`, `e`)."""
        if self.wraps:
            return unit_of(parameter, command_unit)
        ends = {
            "k_r": " s/m",
            "k_rr": " s²/m²",
            "k_rrr": " s³/m³",
            "I_r": " s²/m",
            "tau": "",
            "b": "",
            "c": "",
            "e": " s²/m²",
        }
        if parameter == "I_r" and command_unit == "N":
            return "kg"
        return "m" if parameter == "theta_c" else command_unit + ends[parameter]

    def unit_in(self, template: str, command_unit: str) -> str:
        """The unit of an effect's parameter: `template` is for yaw, with `{moment}` for the moment's unit."""
        if not self.wraps:
            template = _PER_METRE.get(template, template)
        return template.format(moment=command_unit)

    @cached_property
    def _own(self) -> dict[str, str]:
        return {**self.keys, **self.words}

    @cached_property
    def _said(self) -> re.Pattern[str]:
        longest = sorted(self._own, key=len, reverse=True)
        return re.compile("|".join(_word(one) for one in longest))


def _word(text: str) -> str:
    """A pattern of the text as a whole word, and no part of a name of a file or of an effect (`bias-moment`)."""
    if not text.isascii():  # Greek letters and degree signs stand as they like
        return re.escape(text)
    before = r"(?<![\w/-])" if text[0].isalpha() else ""
    after = r"(?![\w|/]|[.-]\w)" if text[-1].isalnum() else ""
    return before + re.escape(text) + after


def renamed(content: Any, keys: Mapping[str, str]) -> Any:
    """Plain data with some keys called otherwise, however deep they are."""
    if not keys:
        return content
    if isinstance(content, dict):
        return {keys.get(key, key): renamed(value, keys) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return type(content)(renamed(value, keys) for value in content)
    return content


_PER_METRE = {
    "{moment} s": "{moment} s/m",
    "{moment} s²": "{moment} s²/m²",
    "{moment} s³": "{moment} s³/m³",
    "{moment}/rad": "{moment}/m",
    "({moment})^1/2 s": "({moment})^1/2 s/m",
    "rad": "m",
    "rad/s": "m/s",
}


def _axis_of(name: str) -> "Axis":
    from automarine_cli.axes import AXES

    return AXES[name]
