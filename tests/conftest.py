"""Fixtures that every test may use."""

import os
import platform
import signal
import warnings

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background: children would not hear Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)

for _library in ("OPENBLAS", "OMP", "MKL"):  # as the console script does, before numpy comes
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
if platform.machine() in ("x86_64", "AMD64"):  # outputs on file are those of AVX2: wider kernels round otherwise
    os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
    os.environ.setdefault("NPY_DISABLE_CPU_FEATURES", "X86_V4 AVX512_ICL AVX512_SPR")
with warnings.catch_warnings():
    warnings.simplefilter("ignore", ImportWarning)  # a processor without them cannot disable them
    import numpy  # noqa: F401

from collections.abc import Callable, Iterator
from pathlib import Path

import figures
import pytest
from click.testing import CliRunner, Result
from hypothesis import HealthCheck, settings
from small_campaign import make_small_campaign

from automarine_cli.commands import automarine
from automarine_cli.commands.run import run_campaign
from automarine_cli.pipeline.results_folder import ResultFolder

# The same examples on every machine, no clock, and no folder of examples beside the repository.
settings.register_profile(
    "house", derandomize=True, deadline=None, database=None, max_examples=50,
    suppress_health_check=(HealthCheck.too_slow,),
)  # fmt: skip
settings.load_profile("house")

WARN = ResultFolder.warn
DEAREST = {
    "test_ardusub_circle", "test_ardusub_processes", "test_base_drag", "test_cluster", "test_diagnose_planted",
    "test_effects", "test_effects_laws", "test_fit_planar", "test_fits_output_error",
    "test_golden", "test_innovations", "test_learned", "test_pages_examples",
    "test_settles", "test_thrust_curve", "test_tune_cli", "test_verdict",
}  # fmt: skip
"""Files that take longest: begun first, so that no process waits at the end for another's long one."""


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A process for each core, and of the quick tests one more, as those of the link wait for clocks."""
    return (os.cpu_count() or 1) + (config.option.markexpr == "not slow")


def pytest_itemcollected(item: pytest.Item) -> None:
    """What `real_data` means."""
    for folder in (mark.args[0] for mark in item.iter_markers("real_data")):
        item.add_marker("slow")
        if not folder.is_dir():
            item.add_marker(pytest.mark.skip(reason="real data not at hand (AUTOMARINE_DATA)"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files in the order of their names, but for the dearest."""
    items.sort(key=lambda item: item.path.stem not in DEAREST)


@pytest.fixture(scope="session", autouse=True)
def strict_figures() -> Iterator[None]:
    """A figure that cannot be made is a warning to a user, and here fails whatever asked for it; see `figures.py`."""

    def refuse(folder: ResultFolder, sentence: str) -> None:
        raise AssertionError(sentence)

    with figures.empty(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(ResultFolder, "warn", refuse)
        yield


@pytest.fixture(scope="module")
def drawn_figures() -> Iterator[None]:
    with figures.drawn():
        yield


@pytest.fixture(scope="session")
def small_day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small campaign in `pool`, and its results as far as the yaw model in `out`; to be read, and copied."""
    folder = tmp_path_factory.mktemp("small_day")
    run_campaign(make_small_campaign(folder / "pool"), out=folder / "out", until="fit-yaw")
    return folder


@pytest.fixture
def lenient_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of what becomes of a result whose figure cannot be drawn."""
    monkeypatch.setattr(ResultFolder, "warn", WARN)


@pytest.fixture
def run() -> Callable[..., Result]:
    """`run("fit-yaw", path, "-o", out)`: the command line in this process; see `click.testing.Result`."""

    def run_command(*arguments: object) -> Result:
        return CliRunner().invoke(automarine, [str(argument) for argument in arguments])

    return run_command
