"""`make pictures`: the figures of the README, made by the tool from sample_runs, small enough for a page.

Usage: python tests/benchmarks/pictures.py [FOLDER]
"""

import io
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure
from PIL import Image

from automarine_cli.report.figures.style import house_style
from automarine_cli.report.figures.thrusters import thruster_figure
from automarine_cli.report.figures.validation import validation_figure
from automarine_cli.report.figures.yaw import drag_figure, inertia_figure
from automarine_cli.workflows.fit_thrusters import fit_thrusters
from automarine_cli.workflows.fit_yaw import fit_yaw
from automarine_cli.workflows.validate import validate

ROOT = Path(__file__).resolve().parent.parent.parent
SAMPLES = ROOT / "sample_runs"
FOLDER = ROOT / ".github" / "pictures"
DPI = 120
COLOURS = 128
VALIDATED = "there_and_back"


def pictures() -> Iterator[tuple[str, Figure]]:
    """Name and figure of each picture."""
    yield "thrusters", thruster_figure(fit_thrusters([SAMPLES / "thrusters"], thrusters_per_test=2))
    with TemporaryDirectory() as folder:
        out = Path(folder) / "yaw"
        fit = fit_yaw([SAMPLES / "steps"], out=out)
        assert fit.seed_method is not None
        yield "drag", drag_figure(fit, fit.seed_method)
        yield "inertia", inertia_figure(fit, fit.seed_method)
        found = validate([SAMPLES / "validation"], model=out / "yaw_model.json").comparison
    place = [run.name for run in found.runs].index(VALIDATED)
    free = {number: scored.free[place] for number, scored in found.models.items()}
    yield "validation", validation_figure(free, found.floors[place])


@house_style
def small_png(figure: Figure) -> bytes:
    """The figure as PNG of few colours, the same bytes each time."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI, metadata={"Software": None})
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(small, format="png", optimize=True)
    return small.getvalue()


def main() -> None:
    """Write every picture."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in pictures():
        content = small_png(figure)
        (folder / f"{name}.png").write_bytes(content)
        print(f"{name}.png: {len(content) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
