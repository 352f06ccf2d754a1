"""A figure's SVG says where its panels lie, what they measure, and which of its groups are which."""

import html
import json
import re

import numpy as np
import pytest

from automarine_cli.report.figures.panels import plain
from automarine_cli.report.figures.style import new_figure, svg


def test_places_and_values_agree() -> None:
    figure, axes = new_figure(2, 2, 6.0, 4.0, sharex="col")
    for ax, y in zip(axes.flat, range(4)):
        ax.plot([0.0, 1.0, 2.0], [y, y + 1.0, y + 3.0], label=f"line {y}")
        ax.axhline(0.5)
    axes[0, 0].set_ylabel(r"Heading $\psi$ [deg]")
    axes[1, 0].set_xlabel("Time [s]")
    axes[1, 1].set_yscale("symlog")
    figure.colorbar(axes[0, 1].scatter([0, 1], [0, 1], c=[0, 1]), ax=axes)
    text = svg(figure).decode()
    panels = json.loads(html.unescape(re.search(r"data-panels=(['\"])(.*?)\1 xmlns", text)[2]))  # type: ignore[index]
    assert [panel["id"] for panel in panels] == ["panel0", "panel1", "panel2", "panel3"]
    assert [panel["says"] for panel in panels] == [
        ["Time [s]", "Heading ψ [deg]"], ["", "Heading ψ [deg]"], ["Time [s]", ""], ["", ""],
    ]  # fmt: skip
    assert [panel["zooms"] for panel in panels] == [True, True, True, False]
    assert panels[0]["lines"] == ["line 0"]
    drawn = text.partition('<g id="panel0-line0">')[2].partition('d="')[2].partition('"')[0]
    places = np.array([float(x) for x in re.findall(r"[\d.]+", drawn)]).reshape(-1, 2)
    left, top, right, bottom = panels[0]["box"]
    values = [
        np.interp(places[:, 0], [left, right], panels[0]["x"]),
        np.interp(bottom - places[:, 1], [0, bottom - top], panels[0]["y"]),
    ]
    assert np.transpose(values) == pytest.approx(np.array([[0, 0], [1, 1], [2, 3]]), abs=1e-3)


def test_names_in_labels_stay_data() -> None:
    figure, axes = new_figure()
    axes[0, 0].plot([0, 1], [0, 1], label="\"'><script>&")
    text = svg(figure).decode()
    assert "<script>" not in text
    found = re.search(r"data-panels=(['\"])(.*?)\1 xmlns", text)
    assert found and json.loads(html.unescape(found[2]))[0]["lines"] == ["\"'><script>&"]


def test_marks_of_mathematics_fall_away() -> None:
    assert plain(r"$(I_r/k_{r|r|})\,\ln\cosh\,(s)$") == "(I_r/k_r|r|) ln cosh  (s)"
