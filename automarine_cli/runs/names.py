"""Names of runs: no two of one campaign alike."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from automarine_cli.logs.formats import stem_of
from automarine_cli.runs.run import Run

NAMED_APART = "another run of this campaign has the same name; the file's name was put in front"


def own_name(source: str) -> str:
    """The name of a run that is alone in its file."""
    return stem_of(source.rsplit("/", 1)[-1])


def named_apart(runs: Sequence[Run]) -> list[Run]:
    """Runs of one campaign, no two of one name; see `names_apart`."""
    names = names_apart([(run.name, run.source) for run in runs])
    return [
        run if run.name == name else replace(run, name=name, notes=(*run.notes, NAMED_APART))
        for run, name in zip(runs, names)
    ]


def names_apart(runs: Sequence[tuple[str, str]]) -> list[str]:
    """Names for runs, given by name and file: those of one name get their file's name in front (without its ending
    where that is enough).
    """
    named = [name for name, _ in runs]
    for prefix in (stem_of, str):
        times = Counter(named)
        for i, (name, (original, source)) in enumerate(zip(named.copy(), runs)):
            if times[name] > 1:
                front = prefix(source)
                named[i] = front if original == own_name(source) else f"{front}:{original}"
    return named
