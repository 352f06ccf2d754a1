"""Commands that do not fit the thruster map: told with the likely cause, or refused where they cannot be of it."""

from types import SimpleNamespace

import pytest

from automarine_cli.errors import RunError
from automarine_cli.runs.run import CommandRange, command_warnings, misfit_of


def commands(low: float, high: float, of_map: tuple[float, float], usual: float = 0.0, unit: str = "") -> CommandRange:
    return CommandRange(low, high, usual, ("n_port", "n_stbd"), of_map, unit)


def warnings_of(ranges: list[CommandRange]) -> tuple[str, ...]:
    return command_warnings([SimpleNamespace(commanded=part) for part in ranges])  # type: ignore[misc]


@pytest.mark.parametrize(
    ("logged", "words", "impossible"),
    [
        (commands(-1, 1, (-400, 400), unit="us"), "-400 to 400 us: they look normalised (-1 to 1)", True),
        (commands(-0.33, 0.29, (-400, 400)), "scale = 400 }", True),
        (commands(1100, 1900, (-400, 400), 1500), "pulses of which the neutral was not subtracted", True),
        (commands(-100, 100, (-1, 1)), "they look like percent, not the signal of this map", True),
        (commands(-100, 100, (-400, 400)), "they look like percent, or the vehicle was hardly driven", False),
        (commands(-100, 100, (-3000, 3000)), "scale = 30 }", False),
        (commands(0, 1, (-1, 1), 0.5), "mostly 0.5, half the range, a neutral that was not subtracted", False),
        (commands(-500, 450, (-400, 400)), "beyond its ends the thrust is a guess", False),
    ],
)
def test_the_likely_cause_is_told(logged: CommandRange, words: str, impossible: bool) -> None:
    coasting = commands(0, 0, logged.of_map, logged.usual, logged.unit)
    misfit = misfit_of([logged, coasting] if logged.low < 0 else [logged])
    assert misfit is not None and words in misfit.sentence and misfit.impossible is impossible
    if impossible:
        with pytest.raises(RunError) as refused:
            warnings_of([logged])
        assert str(refused.value) == misfit.sentence
    else:
        assert warnings_of([logged])[0].endswith(".")


@pytest.mark.parametrize(
    "fine",
    [
        [commands(-400, 400, (-400, 400))],
        [commands(-120, 100, (-400, 400))],  # a calm day
        [commands(0, 0, (-400, 400)), commands(-200, 200, (-400, 400))],  # one run coasts
        [commands(0, 60, (0, 400), 30)],  # ahead only, as the map
        [commands(0, 0, (-400, 400))],
        [],
    ],
)
def test_what_fits_is_not_told(fine: list[CommandRange]) -> None:
    assert misfit_of(fine) is None
    assert warnings_of(fine) == ()
