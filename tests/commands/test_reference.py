"""What `help()` and the site say of functions and their results is complete: attributes, columns, keys."""

import dataclasses
import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from golden import OUTPUTS, read
from repository import SAMPLE_RUNS

import automarine_cli as am
from automarine_cli.commands.command import Command, result_classes
from automarine_cli.pipeline.records import Shown

FUNCTIONS = [name for name in am.__all__ if isinstance(getattr(am, name), Command)]
CLASSES = sorted({result for name in FUNCTIONS for result in result_classes(getattr(am, name))}, key=str)
SHOWN = {*dir(Shown), "to_json", "to_frame"}  # which all results have
ON_FILE = {
    "PlanarFit": "fit-planar out/planar/planar_model.json",
    "Diagnosis": "diagnose-one out/diagnose_one/diagnosis.json",
    "ThrusterDiagnosis": "diagnose-thrusters out/diagnose_thrusters/diagnosis.json",
    "Prediction": "predict-yaw out/predicted/prediction.json",
    "Plan": "plan out/day/plan.json",
    "ResultComparison": "compare out/compared/comparison.json",
    "Tuning": "tune out/tuning/tuning.json",
}
CODE = re.compile(r"`([A-Za-z_]\w*)(?:\([^`]*\))?`")


def paragraphs(result: type) -> dict[str, str]:
    """The paragraphs of a class's docstring by their first word."""
    return {part.split()[0].strip(",:"): part for part in str(result.__doc__).split("\n\n")}


@pytest.fixture(scope="module")
def results() -> list[Any]:
    fit = am.fit_yaw(SAMPLE_RUNS / "steps")
    return [
        am.check(SAMPLE_RUNS / "validation"), am.fit_thrusters(SAMPLE_RUNS / "thrusters", thrusters_per_test=2), fit,
        am.validate(SAMPLE_RUNS / "validation", model=fit), am.slice_log(SAMPLE_RUNS / "hidden_one", by="moment"),
        am.export(fit, to="python"), am.simulate(SAMPLE_RUNS / "campaign.toml"),
    ]  # fmt: skip


@pytest.mark.parametrize("result", CLASSES, ids=lambda result: result.__name__)
def test_every_public_attribute_is_explained(result: type) -> None:
    public = {name for name in dir(result) if not name.startswith("_")} | {f.name for f in fields(result)}
    assert public - SHOWN - {*CODE.findall(str(result.__doc__))} == set()


def fields(result: type) -> Iterator[Any]:
    yield from (each for each in dataclasses.fields(result) if not each.name.startswith("_"))  # type: ignore[arg-type]


def test_columns_and_keys_are_those_of_results(results: list[Any]) -> None:
    for result in results:
        said = paragraphs(type(result))
        assert CODE.findall(said["Keys"]) == list(result.to_json())
        if "Frame" in said:
            assert CODE.findall(said["Frame"]) == list(result.to_frame().columns)


@pytest.mark.parametrize("result", CLASSES, ids=lambda result: result.__name__)
def test_keys_are_those_of_files(result: type) -> None:
    """Of results that take long: as `tests/golden` has their files."""
    keys = CODE.findall(paragraphs(result)["Keys"])
    assert keys[0] == "schema"
    if (place := ON_FILE.get(result.__name__)) is not None:
        name, file = place.split(" ")
        assert keys == list(json.loads(read(OUTPUTS / f"{name}.txt")[file]))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_help_has_settings_and_returns_and_no_shell(name: str) -> None:
    text = str(getattr(am, name).__doc__)
    assert "\nReturns:\n" in text and "automarine " not in text.partition("Settings:")[0] and "\b" not in text
    assert all(f"- **{param.name}**: " in text for param in getattr(am, name).own)
    assert all(f"`{result.__name__}`. " in text for result in result_classes(getattr(am, name)))
