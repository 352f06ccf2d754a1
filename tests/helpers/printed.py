"""Compares printed texts word by word: numbers within a tolerance, or by one in the last decimal."""

import re

NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e-?\d+)?")


def words(text: str) -> list[str]:
    """The words of an output: how lines are folded, and how long rules are, depends on the terminal."""
    return [word for word in text.split() if word.strip("-")]


def same(expected: str, printed: str, close: float) -> bool:
    """Equal words; numbers within `close` (relative), or one in the last decimal."""
    if NUMBER.sub("0", expected) != NUMBER.sub("0", printed):
        return False
    pairs = zip(NUMBER.findall(expected), NUMBER.findall(printed), strict=True)
    return all(abs(float(a) - float(b)) <= max(close * abs(float(a)), last_digit(a)) for a, b in pairs)


def last_digit(number: str) -> float:
    """One in the last decimal of a number as it is written; none for a count."""
    digits, _, power = number.partition("e")
    decimals = len(digits.partition(".")[2])
    return 1.01 * 10.0 ** (int(power or 0) - decimals) if decimals else 0.0
