"""Torn, random and hostile files before the readers: a right answer or one clear sentence, nothing else."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from broken_logs.make import csv_of
from fuzzing import KINDS, case, judge_log, outcome
from hypothesis import given, settings
from hypothesis import strategies as st

from automarine_cli.errors import AutomarineError


@pytest.mark.parametrize("name", KINDS)
def test_torn_files(tmp_path: Path, name: str) -> None:
    kind = KINDS[name]
    path = tmp_path / f"torn{kind.suffix}"
    outcomes = set()
    for number in range(kind.cases):
        path.write_bytes(case(name, number, seed=0))
        outcomes.add(outcome(kind, path))
    assert outcomes == {"read", "refused"}


NUMBERS = st.one_of(
    st.floats(-1e3, 1e3), st.floats(), st.sampled_from([0.0, 0.5, -0.5, 1e9, -9999.0, 1e-320, 1e300, np.nan, np.inf])
)


@settings(max_examples=60)
@given(data=st.data(), count=st.integers(1, 60), steady=st.booleans())
def test_any_table(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, count: int, steady: bool) -> None:
    """Tables with the right columns and any numbers; half of them with a clock that runs evenly."""
    columns = {
        name: np.array(data.draw(st.lists(NUMBERS, min_size=count, max_size=count)))
        for name in ("time_s", "heading_deg", "tau")
    }
    if steady:
        columns["time_s"] = 0.1 * np.arange(count)
    if data.draw(st.booleans()):
        columns["tau"] = np.where(np.arange(count) > count // 3, columns["tau"][0], 0.0)
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.write_bytes(csv_of(pd.DataFrame(columns)))
    try:
        judge_log(path)
    except AutomarineError as refusal:
        assert str(refusal).isprintable(), refusal
