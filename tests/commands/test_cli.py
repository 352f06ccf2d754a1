"""The command line: start-up, exit statuses, one-line refusals, interrupts, help texts and their examples."""

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result
from repository import ROOT

from automarine_cli import __version__
from automarine_cli.commands import CommandGroup, automarine, options
from automarine_cli.commands import terminal as echo
from automarine_cli.errors import LogError
from automarine_cli.report.tables import Table

HEAVY = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib")
MAIN = f"""
import sys
from automarine_cli.commands import main
try:
    main()
except SystemExit:
    print(*(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)
    print(*(name for name in ("check", "fit_yaw", "run") if f"automarine_cli.commands.{{name}}" in sys.modules))
"""
HELP = f"""
import sys
from automarine_cli.commands import automarine
for word in sys.argv[1:]:
    automarine([word] if word.startswith("-") else [word, "--help"], prog_name="automarine", standalone_mode=False)
    heavy = [name for name in {HEAVY} if name in sys.modules]
    assert not heavy, (word, heavy)
"""
TRY = """
import click
from automarine_cli.commands import automarine, main
automarine.add_command(click.Command("try", callback=lambda: {body}))
main()
"""


def python(
    *arguments: str, code: str | None = None, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """`python -m automarine_cli ...`, or some code, in a process of its own."""
    command = [sys.executable, *(("-c", code) if code else ("-m", "automarine_cli")), *arguments]
    environment = os.environ | (env or {})
    return subprocess.run(
        command, capture_output=True, encoding="utf-8", cwd=ROOT, env=environment, check=False, timeout=600
    )


CONTEXT = click.Context(automarine)
COMMANDS: dict[str, click.Command] = {
    name: automarine.get_command(CONTEXT, name)  # type: ignore[misc]
    for name in automarine.list_commands(CONTEXT)
}


def fails_with(problem: BaseException, *flags: str) -> Result:
    """What the command line makes of an exception in a command."""

    def body() -> None:
        raise problem

    group = CommandGroup("automarine")
    group.add_command(options.verbosity(click.command("try")(body)))  # type: ignore[type-var]
    return CliRunner().invoke(group, ["try", *flags])


# Start-up


def test_help_imports_nothing_heavy() -> None:
    """Of every command, one after the other in one process."""
    result = python("--help", "--version", *COMMANDS, code=HELP)
    assert result.stderr.strip() == ""
    assert result.stdout.count("Usage: automarine ") == 1 + len(COMMANDS)


def test_completion_works_and_imports_nothing_heavy() -> None:
    words = {"COMP_WORDS": "automarine --ver", "COMP_CWORD": "1"}
    for how, said in (("source", "_AUTOMARINE_COMPLETE"), ("complete", "--version")):
        result = python(code=MAIN, env={"_AUTOMARINE_COMPLETE": f"bash_{how}"} | words)
        assert said in result.stdout and result.stderr.strip() == ""


def test_the_list_of_commands_is_what_the_commands_say() -> None:
    """It is read off their files: importing all of them would take longer than importing click."""
    listed = python("--help", code=MAIN).stdout
    assert listed.startswith("Usage: ")
    for name, command in COMMANDS.items():
        assert f"  {name} " in listed and command.short_help and command.short_help in listed
    assert listed.splitlines()[-1] == ""


def test_module_and_version() -> None:
    result = python("--version")
    first, libraries = result.stdout.splitlines()
    assert (result.returncode, first, result.stderr) == (0, f"automarine, version {__version__}", "")
    assert [word.split()[0] for word in libraries.split(", ")] == ["python", "click", *HEAVY]


def test_output_is_utf8_in_any_locale() -> None:
    code = TRY.format(body=r"click.echo('\u03c8\u00b2 \udce4')")
    plain = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}
    result = python("try", code=code, env=plain)
    assert (result.returncode, result.stdout, result.stderr) == (0, "ψ² \\udce4\n", "")


# Exit statuses


@pytest.mark.parametrize(
    ("problem", "status", "message"),
    [
        (LogError("a.csv, row 3: found 'x', expected a number"), 1, "a.csv, row 3: found 'x', expected a number"),
        (OSError(28, "No space"), 1, "[Errno 28] No space; check the path, its permissions and the free disk space"),
        (MemoryError(), 1, "not enough memory; "),
        (
            KeyError("heading"),
            1,
            "KeyError: 'heading'; this is a bug in automarine, please report it (-vv shows where)",
        ),
        (KeyboardInterrupt(), 130, "Interrupted; nothing was left half written."),
    ],
)
def test_every_end_is_one_line_and_a_status(problem: BaseException, status: int, message: str) -> None:
    result = fails_with(problem)
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (status, "", 1)
    assert result.stderr.removeprefix("Error: ").startswith(message)
    assert result.stderr.startswith("Error: ") == (status == 1)


def test_a_defect_shows_its_place_with_vv_and_wrong_usage_is_status_2(run: Callable[..., Result]) -> None:
    assert "Traceback" not in fails_with(KeyError("heading"), "-v").stderr
    assert "Traceback (most recent call last)" in fails_with(KeyError("heading"), "-vv").stderr
    for arguments in (["no-such-command"], ["--no-such-option"]):
        result = run(*arguments)
        assert result.exit_code == 2 and "Usage: " in result.stderr
    for option, right in (("--target", "write --for"), ("--model", "write MODEL.json alone")):
        assert run("tune", option, "x").stderr.startswith(f"Error: No such option '{option}'; {right}\n")


SLOW = """
import sys, time
from pathlib import Path
import click
from automarine_cli.__main__ import main
from automarine_cli.commands import automarine
from automarine_cli.pipeline.results_folder import result_folder

def body():
    settings = dict(command="try", options={}, inputs=(), seed=None, overwrite=False)
    with result_folder(Path(sys.argv[2]), **settings) as folder:
        folder.write("a", "1")
        click.echo("ready")
        time.sleep(3600)

out = click.Argument(["out"], expose_value=False)
automarine.add_command(click.Command("try", callback=body, params=[out]))
main()
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_signals_leave_nothing_half_written(tmp_path: Path, how: int) -> None:
    command = [sys.executable, "-c", SLOW, "try", str(tmp_path / "deep" / "out")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(how)
    _, message = process.communicate(timeout=600)
    assert (process.returncode, message) == (130, "Interrupted; nothing was left half written.\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("lines", [1, 100_000])
def test_closed_pipe_is_silent(lines: int) -> None:
    code = TRY.format(body=f"click.echo('x\\n' * {lines})")
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-c", code, "try"]
    result = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, cwd=ROOT, check=False)
    os.close(writer)
    assert (result.returncode, result.stderr) == (141, b"")


# What commands say


class Outcome:
    """A result with twelve runs set aside, three of them for one reason."""

    def to_json(self) -> dict[str, Any]:
        whys = ["never moved", *(f"turned {i} degrees" for i in range(9)), "never moved", "never moved"]
        aside = [{"file": "steps/a.csv", "run": f"r{i}", "why": why} for i, why in enumerate(whys)]
        return {"schema": "automarine/trial/1", "k": 1.5, "runs": {"used": 3, "set_aside": aside}}


def say(*flags: str) -> Result:
    """The shared tail of commands under these flags."""

    @click.command()
    @options.out
    @options.as_json
    @options.verbosity
    def trial(out: Path | None, as_json: bool) -> None:
        progress = echo.terminal_progress()
        progress("read logs", 1, 1)
        table = Table("Drag", ("model", "k"), (("1", "1.5"),))
        echo.echo_result(Outcome(), as_json=as_json, out=out, tables=(table, "One.", "Two."), files=("a.json",))

    return CliRunner().invoke(trial, list(flags))


def test_runs_set_aside_are_counted_and_named() -> None:
    lines = say().stderr.splitlines()
    assert lines[:3] == [
        "Set aside: 12 runs", "  steps/a.csv, run r0, and 2 more: never moved",
        "  steps/a.csv, run r1: turned 0 degrees",
    ]  # fmt: skip
    assert lines[-1] == "  and 2 more (-v lists all)"
    loud = say("-v").stderr.splitlines()
    assert (loud[0], loud[2], len(loud)) == ("read logs: 1", "  steps/a.csv, run r0: never moved", 14)


def test_bar_comes_late_and_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 0.5, 2.0, 2.05, 3.0, 3.1])
    lines: list[str] = []
    monkeypatch.setattr(echo, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(echo.click, "echo", lambda text, **_: lines.append(text))
    bar = echo.Bar()
    for done in range(5):
        bar("fit", done, 5)
    assert len(lines) == 2  # at 2.0 and 3.0 s, not in the first second and not twice in a tenth
    assert lines[-1].endswith("] 4/5")
    bar("fit", 5, 5)
    assert lines[-1] == "\r\x1b[K"


# Help texts and examples


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_has_an_example_that_parses_in_a_fresh_folder(name: str) -> None:
    command = COMMANDS[name] if name else automarine
    examples = [shlex.split(line)[1:] for line in echo.examples(command)]
    assert examples, f"the help of {name or 'automarine'} has no line `automarine ...` after `Example:`"
    assert not name or examples[-1][0] == name  # what comes before makes the files that it needs
    written: list[str] = []
    for arguments in examples:
        out = arguments[arguments.index("-o") + 1] if "-o" in arguments else ""
        read = [word for word in arguments[1:] if word.startswith("out/") and word != out and arguments[0] != "serve"]
        assert [word for word in read if not any(f"{word}/".startswith(f"{place}/") for place in written)] == []
        written.append(out or "nothing")
        try:
            COMMANDS[arguments[0]].make_context(arguments[0], arguments[1:])
        except click.BadParameter as problem:  # a file that another example makes
            assert "does not exist" in problem.message


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_options_in_groups_and_a_page_to_go_on(name: str) -> None:
    result = CliRunner(env={"COLUMNS": "80"}).invoke(automarine, [name, "--help"])
    groups = re.findall(r"^([A-Z]\w+):$", result.stdout, flags=re.MULTILINE)
    noun = name.partition("-")[0].capitalize()
    assert result.exit_code == 0 and groups == [g for g in ("Input", noun, "Output", "General") if g in groups]
    assert {"Output", "General"} <= set(groups) and "Options:" not in result.stdout
    assert result.stdout.endswith(f"  Learn more: automarine guide {name}\n")
    assert max(map(len, result.stdout.splitlines())) <= 80


@pytest.mark.parametrize("name", COMMANDS)
def test_options_say_what_they_do_and_the_shared_ones_are_there(name: str) -> None:
    params = COMMANDS[name].params
    for param in params:
        assert not isinstance(param, click.Option) or param.help, f"{name}: {param.opts} has no help"
    flags = {flag for param in params for flag in param.opts}
    shared = {"--json", "-q", "-v"}
    if any(param.name == "logs" for param in params):
        shared |= {"--columns", "--jobs"}
    if "--out" in flags:
        shared |= {"-o", "--overwrite"}
    assert shared <= flags
