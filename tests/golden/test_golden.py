"""Every command on `sample_runs` prints and writes what is in `outputs/`; `--update` writes it anew."""

import shlex
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click import Context
from golden import COMMANDS, LINES, OUTPUTS, automarine, differences, read, run, sources, write
from repository import SAMPLE_RUNS

ELSEWHERE = {"serve", "collect", "guide", "completion"}  # two machines, and texts that are files already

MOST = 40  # differences that a message lists

Outputs = dict[str, str]


@pytest.fixture(scope="module")
def outputs_of(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Outputs]]:
    """Runs a command once, after those that write what it reads."""
    outputs: dict[str, Outputs] = {}

    def outputs_of(name: str) -> Outputs:
        if name not in outputs:
            for source in sources(name):
                outputs_of(source)
            outputs[name] = run(COMMANDS[name])
        return outputs[name]

    folder = tmp_path_factory.mktemp("golden")
    shutil.copytree(SAMPLE_RUNS, folder / "sample_runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield outputs_of


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (part == "slow")) for part in LINES for name in LINES[part]]
)
def test_outputs_are_as_before(name: str, outputs_of: Callable[[str], Outputs], request: pytest.FixtureRequest) -> None:
    path, update = OUTPUTS / f"{name}.txt", request.config.getoption("--update", default=False)
    actual = outputs_of(name)
    listed = differences(read(path), actual)
    if listed and update:
        write(path, actual)
    elif listed:
        pytest.fail("\n".join([f"automarine {shlex.join(COMMANDS[name])}", *listed[:MOST]]), pytrace=False)


def test_every_command_has_outputs() -> None:
    listed = set(automarine.list_commands(Context(automarine)))
    assert {arguments[0] for arguments in COMMANDS.values()} == listed - ELSEWHERE
    assert {path.stem for path in OUTPUTS.iterdir()} == set(COMMANDS)


def test_the_comparison_can_fail(tmp_path: Path) -> None:
    model = '{"k_rr": {"value": 1.25, "unit": "nu s²"}, "runs": [1, 2], "says": "It is 0.50 wide", "used": true}'
    outputs = {"printed": "k_rr  1.25 [1.2, 1.3]\n", "yaw_model.json": model, "table.csv": "k,1.25000001\n"}
    write(tmp_path / "x.txt", outputs)
    assert differences(read(tmp_path / "x.txt"), outputs) == []
    close = {"printed": "k_rr 1.26\n[1.2, 1.3]", "yaw_model.json": model.replace("1.25", "1.2500001")}
    assert differences(outputs, outputs | close) == []
    for name, before, after, where in (
        ("printed", "1.25", "1.27", "k_rr 1.27"),
        ("printed", "1.3]", "1.3] nu", "nu"),
        ("yaw_model.json", "1.25", "1.25001", "k_rr.value"),
        ("yaw_model.json", "nu s²", "nu s", "k_rr.unit"),
        ("yaw_model.json", "[1, 2]", "[1]", "runs"),
        ("yaw_model.json", "0.50", "0.60", "says"),
        ("yaw_model.json", "true", "1", "used"),
        ("yaw_model.json", '"used"', '"users"', "users"),
        ("table.csv", "1.25000001", "1.25001", "k,1.25001"),
    ):
        [*lines] = differences(outputs, outputs | {name: outputs[name].replace(before, after)})
        assert lines and all(line.startswith(f"{name}: ") for line in lines) and where in "".join(lines)
    assert differences(outputs, {"printed": outputs["printed"]}) != []
