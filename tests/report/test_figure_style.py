"""The look of figures: the same bytes whatever the user's settings; those of a fit by their structure."""

import json
import re
from collections.abc import Callable
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from identified import identify
from made_campaigns import both_ways, campaign
from matplotlib.figure import Figure

from automarine_cli.report import fit_report  # noqa: F401  registers what a fit shows
from automarine_cli.report.figures.style import FIGURE_WRITERS, house_style, model_look, new_figure
from automarine_cli.report.sections import sections

SVG = "{http://www.w3.org/2000/svg}"
png, svg, pdf = (FIGURE_WRITERS[kind] for kind in ("png", "svg", "pdf"))
pytestmark = pytest.mark.usefixtures("drawn_figures")


@house_style
def small() -> Figure:
    """Text, lines and a legend."""
    figure, axes = new_figure(2, 1, 3.0, 3.0, sharex=True)
    for model in "123":
        axes[0, 0].plot([-1.0, float(model)], **model_look(model, "3"), label=f"model {model}")
    axes[1, 0].set_xlabel(r"moment $\tau$")
    axes[0, 0].legend()
    return figure


@house_style
def with_colour_bar() -> Figure:
    """Two panels, one with a colour bar."""
    figure, axes = new_figure(1, 2, 7.0, 3.0)
    for ax in axes.flat:
        mesh = ax.pcolormesh(np.arange(12.0).reshape(3, 4))
        ax.set_ylabel("heading [deg]")
    figure.colorbar(mesh, ax=axes[0, 1], pad=0.01, label="gap [deg]")
    return figure


@pytest.mark.parametrize(
    ("save", "draw"),
    [(png, small), (svg, with_colour_bar), *(pytest.param(kind, small, marks=pytest.mark.slow) for kind in (svg, pdf))],
)
def test_the_same_bytes_whatever_the_user_has_set(save: Callable[[Figure], bytes], draw: Callable[[], Figure]) -> None:
    figure = draw()
    first = save(figure)
    assert save(figure) == first
    with matplotlib.rc_context({"font.size": 20.0, "lines.linewidth": 5.0, "axes.facecolor": "red"}):
        assert save(draw()) == first
        assert matplotlib.rcParams["font.size"] == 20.0  # and the user's settings are left alone


def test_files_hold_no_date_and_no_program() -> None:
    pixels, picture, page = (save(small()) for save in (png, svg, pdf))
    width, height = (int.from_bytes(pixels[start : start + 4], "big") for start in (16, 20))
    assert (pixels[:8], width, height) == (b"\x89PNG\r\n\x1a\n", 600, 600)  # 200 dpi
    assert picture.startswith(b"<?xml") and page.startswith(b"%PDF") and b">model 1</text>" in picture
    for word in (b"Software", b"tIME", b"Creation", b"dc:date", b"/Producer", b"/Creator", b"Matplotlib v"):
        assert all(word not in data for data in (pixels, picture, page))


def is_complete(figure: Figure) -> None:
    """Labels with units on the outer axes, all data finite."""
    panels = [ax for ax in figure.axes if ax.axison]
    labels = [label for ax in panels for label in (ax.get_xlabel(), ax.get_ylabel()) if label]
    assert labels and all(re.search(r"\[.+\]", label) for label in labels), labels
    for line in (line for ax in panels for line in ax.lines):
        assert np.isfinite(np.asarray(line.get_xydata(), float)).all()
    assert FIGURE_WRITERS["png"](figure).startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.parametrize("moments", [both_ways((0.2, 0.5, 0.8, 1.1)), [-0.3, -0.6, -0.9]])
def test_figures_of_half_turns_are_complete(moments: list[float]) -> None:
    fit = identify(campaign(moments, seed=1, gain_scatter=0.02))
    drawn = {name: draw() for name, draw in sections(fit).figures.items()}
    assert drawn.keys() >= {"half_turns", "drag", "inertia", "collapse", "residuals"}
    for figure in drawn.values():
        is_complete(figure)


def test_an_svg_tells_where_its_points_are() -> None:
    """Points, a line and bars, read back from the drawing as the page's script does, are the data; labels are words."""
    x, y = np.array([0.5, 2.0, 40.0]), np.array([-3.0, 0.25, 7.0])
    figure, ((top,), (bottom,)) = new_figure(2, 1, 4.0, 4.0)
    top.plot(x, y, "o", label="measured")
    top.plot(x, y + 1.0, label=r"$k_{rr}$ <&> \run")
    top.set(xscale="log", xlabel="Time [s]", ylabel=r"Heading $\psi$ [deg]")
    bottom.barh([0, 1], [3.0, 5.0], label="named")
    bottom.set_yticks([0, 1], ["swirl", "drag"])
    root = ElementTree.fromstring(svg(figure))
    by_id = {element.get("id"): element for element in root.iter()}
    above, below = json.loads(by_id["readings"].text or "")
    assert [series["name"] for series in above["series"]] == ["measured", r"k_rr <&> \run"]
    assert [above[side]["label"] for side in "xy"] == ["Time [s]", "Heading ψ [deg]"] and above["x"]["log"]
    marks = [(mark.get("x"), mark.get("y")) for mark in by_id[above["series"][0]["id"]].iter(f"{SVG}use")]
    (line,) = by_id[above["series"][1]["id"]].iter(f"{SVG}path")
    for points, values in ((marks, y), (re.findall(r"[ML] (\S+) (\S+)", line.get("d", "")), y + 1.0)):
        at = (np.array(points, dtype=float) - above["box"][:2]) / above["box"][2:]
        low, high = np.log(above["x"]["ends"])
        np.testing.assert_allclose(np.exp(low + at[:, 0] * (high - low)), x, rtol=1e-3)
        low, high = above["y"]["ends"]
        np.testing.assert_allclose(high - at[:, 1] * (high - low), values, atol=1e-3)
    assert below["series"] == [{"name": "named", "at": [[3.0, 0.0], [5.0, 1.0]]}]
    assert below["y"]["words"] == {"0": "swirl", "1": "drag"}
