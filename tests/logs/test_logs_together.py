"""CSV files that are read together give what each gives alone, whatever stands between them."""

from pathlib import Path

import numpy as np
import pytest

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, LogTable, read_logs

HEADER = "time_s,heading_deg,tau"
GOOD = f"{HEADER}\n0.0,10.5,0\n0.1,10.75,-0.5\n0.2,11,1e-3\n"
CONTENTS = {
    "good": GOOD,
    "no_last_line_end": GOOD.rstrip("\n"),
    "other_header": GOOD.replace("tau", "tau_Nm"),
    "header_only": HEADER,
    "header_and_its_line_end": f"{HEADER}\n",
    "missing": GOOD.replace("10.75", "").replace("1e-3", "NaN"),
    "a_word": GOOD.replace("10.75", "abc"),
    "a_word_at_the_end": GOOD + "0.3,11.5,none at all\n",
    "too_few": GOOD + "0.3,11.5\n",
    "too_many": GOOD + "0.3,11.5,0,0\n",
    "open_quote": GOOD + '0.3,"11.5,0\n',
    "quoted": GOOD.replace("10.75", '"10.75"'),
    "infinite": GOOD.replace("10.75", "inf"),
    "comment": GOOD.replace("0.1,", "# a remark\n0.1,"),
    "blank_line": GOOD.replace("0.1,", "\n0.1,"),
    "carriage_returns": GOOD.replace("\n", "\r\n"),
    "plus": GOOD.replace("10.75", "+10.75"),
    "runs": f"{HEADER},run\n0.0,10.5,0,01\n0.1,10.75,0,01\n0.2,11,0,2\n",
    "empty": "",
}


def told(found: LogTable | LogError) -> object:
    """A table or a refusal, to be compared."""
    if isinstance(found, LogError):
        return str(found)
    columns = {name: values.tobytes() for name, values in found.columns.items()}
    codes = None if found.run_code is None else found.run_code.tolist()
    return columns, found.rows.tolist(), found.run_names, codes, found.notes, found.names, found.moment_unit


@pytest.mark.parametrize("seed", range(6))
def test_together_as_alone(seed: int, tmp_path: Path) -> None:
    random = np.random.default_rng(seed)
    names = [*CONTENTS, *["good"] * 12] if seed else sorted([*CONTENTS, *CONTENTS])
    files = []
    for i, name in enumerate(random.permutation(names) if seed else names):
        path = tmp_path / f"{i:02d}_{name}.csv"
        path.write_text(CONTENTS[name], newline="")
        files.append(LogFile(path, path.name, named=False))
    together = read_logs(files, dof=YAW)
    alone = [found for file in files for found in read_logs([file], dof=YAW)]
    assert [told(one) for one in together] == [told(one) for one in alone]
    good = [isinstance(one, LogTable) for one in together]
    assert any(good) and not all(good)


def test_one_torn_file_spoils_no_other(tmp_path: Path) -> None:
    files = []
    for i in range(20):
        path = tmp_path / f"{i:02d}.csv"
        path.write_text(GOOD if i != 7 else GOOD + "0.3,\x07garbage")
        files.append(LogFile(path, path.name, named=False))
    found = read_logs(files, dof=YAW)
    assert [i for i, one in enumerate(found) if isinstance(one, LogError)] == [7]
    assert str(found[7]).startswith("07.csv, row 5: found 2 cells, expected 3 as in the header (row 1)")
