"""A number of a model file: its size."""

from automarine_cli.pipeline.records import Codec, Place
from automarine_cli.results.estimate import Given

SMALLEST, LARGEST = 1e-30, 1e30  # of any number: beyond it arithmetic overflows


def number_at(given: Given, codec: Codec, place: Place) -> float:
    """The value of a number that must be there. Raises ModelError with its `place`."""
    value = given.value
    if value is None:
        raise codec.refusal(place, "found nothing, expected a number")
    if value and not SMALLEST <= abs(value) <= LARGEST:
        raise codec.refusal(place, f"found {value:g}, expected 0 or a size of {SMALLEST:g} to {LARGEST:g}")
    return value
