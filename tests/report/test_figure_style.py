"""The look of figures: the same bytes whatever the user's settings, colours that differ in grey too."""

from collections.abc import Callable

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from automarine_cli.report.figures.style import COLOURS, FORMATS, MODEL_COLOURS, MODEL_LINES, house_style, new_figure

png, svg, pdf = (FORMATS[kind] for kind in ("png", "svg", "pdf"))
pytestmark = pytest.mark.usefixtures("drawn_figures")


@house_style
def drawn() -> Figure:
    """A small figure with text, lines and a legend."""
    figure, axes = new_figure(2, 1, 3.0, 3.0, sharex=True)
    for model, colour in MODEL_COLOURS.items():
        x = np.linspace(-1.0, 1.0, 50)
        axes[0, 0].plot(x, x * float(model), color=colour, linestyle=MODEL_LINES[model], label=f"model {model}")
    axes[1, 0].plot([0, 1], [0, -1])
    axes[1, 0].set_xlabel(r"moment $\tau$")
    axes[0, 0].legend()
    return figure


def test_png_is_200_dpi_without_date_or_program() -> None:
    data = png(drawn())
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = (int.from_bytes(data[start : start + 4], "big") for start in (16, 20))
    assert (width, height) == (600, 600)
    assert b"Software" not in data
    assert b"tIME" not in data
    assert b"Creation Time" not in data


def test_same_bytes_whatever_the_user_has_set() -> None:
    plain = png(drawn())
    with matplotlib.rc_context({"font.size": 20.0, "lines.linewidth": 5.0, "axes.facecolor": "red"}):
        assert png(drawn()) == plain
        assert matplotlib.rcParams["font.size"] == 20.0  # and the user's settings are left alone
    assert png(drawn()) == plain


@house_style
def with_colour_bar() -> Figure:
    """Two panels, one with a colour bar."""
    figure, axes = new_figure(1, 2, 7.0, 3.0)
    for ax in axes.flat:
        mesh = ax.pcolormesh(np.arange(12.0).reshape(3, 4))
        ax.set_ylabel("heading [deg]")
    figure.colorbar(mesh, ax=axes[0, 1], pad=0.01, label="gap [deg]")
    return figure


@pytest.mark.parametrize("save", [png, svg, pdf])
@pytest.mark.parametrize("draw", [drawn, with_colour_bar])
def test_the_same_figure_saved_again_is_the_same_bytes(
    save: Callable[[Figure], bytes], draw: Callable[[], Figure]
) -> None:
    figure = draw()
    first = save(figure)
    assert [save(figure), save(figure), save(draw())] == [first, first, first]


def test_svg_and_pdf_hold_no_date_and_no_program() -> None:
    picture, page = svg(drawn()), pdf(drawn())
    assert picture.startswith(b"<?xml") and page.startswith(b"%PDF")
    for word in (b"dc:date", b"CreationDate", b"/Producer", b"/Creator", b"Matplotlib v"):
        assert word not in picture and word not in page
    assert b">model 1</text>" in picture


def test_axes_come_as_a_grid() -> None:
    assert new_figure()[1].shape == (1, 1)
    assert new_figure(2, 3)[1].shape == (2, 3)


def lightness(colour: str) -> float:
    """Relative luminance (Rec. 709), what a grey print shows, 0 to 1."""
    return float(np.dot([0.2126, 0.7152, 0.0722], to_rgb(colour)))


def test_model_colours_differ_in_grey_and_their_lines_differ_too() -> None:
    greys = sorted(lightness(colour) for colour in MODEL_COLOURS.values())
    assert min(np.diff(greys)) > 0.2
    assert len({str(line) for line in MODEL_LINES.values()}) == 3


@pytest.mark.parametrize("name", ["orange", "blue", "sky", "vermilion", "green", "purple", "yellow", "black"])
def test_palette_is_okabe_and_itos(name: str) -> None:
    expected = {
        "black": "#000000", "orange": "#E69F00", "sky": "#56B4E9", "green": "#009E73",
        "yellow": "#F0E442", "blue": "#0072B2", "vermilion": "#D55E00", "purple": "#CC79A7",
    }  # fmt: skip
    assert COLOURS[name] == expected[name]
