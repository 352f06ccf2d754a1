"""`make pictures`: the figures of the README and its pages, made by the tool from sample_runs, small enough for a page.

Usage: python tests/benchmarks/pictures.py [FOLDER]
"""

import io
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure
from PIL import Image
from pool_day import ARM, write_pool_day

from automarine_cli.commands.diagnose import diagnose
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.commands.init import init
from automarine_cli.commands.validate import validate
from automarine_cli.report.figures.runs import drag_figure, half_turns_figure, inertia_figure, validation_figure
from automarine_cli.report.figures.style import house_style
from automarine_cli.report.figures.thrusters import thruster_figure

ROOT = Path(__file__).resolve().parent.parent.parent
SAMPLES = ROOT / "sample_runs"
HIDDEN = SAMPLES / "hidden_one"
FOLDER = ROOT / ".github" / "pictures"
DPI = 120
COLOURS = 128
VALIDATED = "there_and_back"


def pictures() -> Iterator[tuple[str, Figure]]:
    yield "thrusters", thruster_figure(fit_thrusters([SAMPLES / "thrusters"], thrusters_per_test=2))
    with TemporaryDirectory() as folder:
        yield from of_a_fit(Path(folder))
        yield from of_what_is_hidden(Path(folder))
        yield from of_other_peoples_files(Path(folder))


def of_a_fit(folder: Path) -> Iterator[tuple[str, Figure]]:
    """The campaign in which nothing is hidden: drag, inertia, one validation run."""
    out = folder / "yaw"
    fit = fit_yaw([SAMPLES / "steps"], out=out)
    assert fit.seed_method is not None
    yield "drag", drag_figure(fit, fit.seed_method)
    yield "inertia", inertia_figure(fit, fit.seed_method)
    yield "validation", one_run(SAMPLES / "validation" / f"{VALIDATED}.csv", out / "yaw_model.json")


def of_what_is_hidden(folder: Path) -> Iterator[tuple[str, Figure]]:
    """The campaign with a hidden effect: a run before, where the gap is, why, and after."""
    fitted, found = folder / "hidden", folder / "diagnosis"
    log = HIDDEN / f"{VALIDATED}.csv"
    fit_yaw([HIDDEN], fit_to="whole-runs", out=fitted)
    yield "before", one_run(log, fitted / "yaw_model.json")
    result = diagnose([HIDDEN], model=fitted / "yaw_model.json", out=found)
    for name in ("where", "why", "before_after"):
        yield name, result.plot(name)
    yield "after", one_run(log, found / "extended_model.json")


def of_other_peoples_files(folder: Path) -> Iterator[tuple[str, Figure]]:
    """A day in other people's columns: the thrusters' curve, and the half-turns that the moment made of it explains."""
    day, written = write_pool_day(folder / "pool_day"), folder / "pool.toml"
    init(day, out=written)
    answered = written.read_text().replace('arm_m = "?"', f"arm_m = {ARM}").replace('per_test = "?"', "per_test = 1")
    columns = folder / "columns.toml"
    columns.write_text(answered[answered.index("[columns]") : answered.index("[thrusters]")])
    thrusters = fit_thrusters([day / "bollard_T200.csv"], columns=columns)
    yield "pool_thrusters", thruster_figure(thrusters)
    fit = fit_yaw([day / "run_*.csv"], columns=columns, thrusters=thrusters, arm=ARM)
    yield "pool_half_turns", half_turns_figure(fit)


def one_run(log: Path, model: Path) -> Figure:
    """A log and what the models of a file make of its commands."""
    found = validate([log], model=model)
    free = {number: scored.free[0] for number, scored in found.models.items()}
    return validation_figure(free, found.floors[0])


@house_style
def small_png(figure: Figure) -> bytes:
    """The figure as PNG of few colours, the same bytes each time."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI, metadata={"Software": None})
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(small, format="png", optimize=True)
    return small.getvalue()


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in pictures():
        content = small_png(figure)
        (folder / f"{name}.png").write_bytes(content)
        print(f"{name}.png: {len(content) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
