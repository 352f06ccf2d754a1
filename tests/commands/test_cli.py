"""The command line: start-up, exit statuses, one-line refusals, interrupts, help texts and their examples."""

import json
import os
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

LIST_HEAVY = f"""
import sys
from automarine_cli.commands import main
try:
    main()
except SystemExit:
    print(*(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)
"""

HELP = f"""
import sys
from automarine_cli.commands import automarine
for word in sys.argv[1:]:
    automarine([word] if word.startswith("-") else [word, "--help"], prog_name="automarine", standalone_mode=False)
    heavy = [name for name in {HEAVY} if name in sys.modules]
    assert not heavy, (word, heavy)
"""

LIST_LOADED = """
import sys
from automarine_cli.commands import main
try:
    main()
except SystemExit:
    files = ("check", "fit_yaw", "run", "validate")
    print([name for name in files if f"automarine_cli.commands.{name}" in sys.modules])
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
    start = ["-c", code] if code else ["-m", "automarine_cli"]
    return subprocess.run(
        [sys.executable, *start, *arguments],
        capture_output=True,
        encoding="utf-8",
        cwd=ROOT,
        env=os.environ | (env or {}),
        check=False,
        timeout=600,
    )


def commands() -> dict[str, click.Command]:
    ctx = click.Context(automarine)
    return {name: automarine.get_command(ctx, name) for name in automarine.list_commands(ctx)}  # type: ignore[misc]


def examples(command: click.Command) -> list[list[str]]:
    """Arguments of each `automarine ...` line after `Example:` in a help text."""
    _, _, tail = (command.help or "").partition("Example:")
    lines = (line.strip() for line in tail.splitlines())
    return [shlex.split(line)[1:] for line in lines if line.startswith("automarine ")]


EVERY_COMMAND = pytest.mark.parametrize("name", ["", *commands()])


def command_called(name: str) -> click.Command:
    """The group itself for the empty name."""
    return commands()[name] if name else automarine


def trial_group(body: Callable[[], Any]) -> CommandGroup:
    """A group of the house's kind with one command `try` that runs `body`."""
    group = CommandGroup("automarine")
    group.add_command(options.verbosity(click.command("try")(body)))  # type: ignore[type-var]
    return group


def fails_with(problem: BaseException, *flags: str) -> Result:
    """What the command line makes of an exception in a command."""

    def body() -> None:
        raise problem

    return CliRunner().invoke(trial_group(body), ["try", *flags])


# Start-up


def test_help_imports_nothing_heavy() -> None:
    """Of every command, one after the other in one process."""
    found = python("--help", "--version", *commands(), code=HELP)
    assert found.stderr.strip() == ""
    assert found.stdout.count("Usage: automarine ") == 1 + len(commands())


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_works_and_imports_nothing_heavy(shell: str) -> None:
    script = python(code=LIST_HEAVY, env={"_AUTOMARINE_COMPLETE": f"{shell}_source"})
    assert "_AUTOMARINE_COMPLETE" in script.stdout
    assert script.stderr.strip() == ""
    # fish hands over the word under the cursor instead of its number
    words = {"COMP_WORDS": "automarine --ver", "COMP_CWORD": "--ver" if shell == "fish" else "1"}
    answer = python(code=LIST_HEAVY, env={"_AUTOMARINE_COMPLETE": f"{shell}_complete"} | words)
    assert "--version" in answer.stdout
    assert answer.stderr.strip() == ""


def test_module_and_version() -> None:
    found = python("--version")
    first, libraries = found.stdout.splitlines()
    assert (found.returncode, first, found.stderr) == (0, f"automarine, version {__version__}", "")
    assert [word.split()[0] for word in libraries.split(", ")] == ["python", "click", *HEAVY]
    assert python("--help").stdout.startswith("Usage: automarine [OPTIONS] COMMAND")


def test_output_is_utf8_in_any_locale() -> None:
    code = TRY.format(body=r"click.echo('\u03c8\u00b2 \udce4')")
    plain = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}
    found = python("try", code=code, env=plain)
    assert (found.returncode, found.stdout, found.stderr) == (0, "ψ² \\udce4\n", "")


# Exit statuses


def test_refusal_is_one_line_and_status_1() -> None:
    found = fails_with(LogError("a.csv, row 3: found 'x', expected a number"))
    assert (found.exit_code, found.stdout) == (1, "")
    assert found.stderr == "Error: a.csv, row 3: found 'x', expected a number\n"


def test_wrong_usage_is_status_2(run: Callable[..., Result]) -> None:
    for arguments in (["no-such-command"], ["--no-such-option"]):
        found = run(*arguments)
        assert found.exit_code == 2
        assert "Usage: " in found.stderr


def test_defect_is_one_line_and_its_place_only_with_vv() -> None:
    found = fails_with(KeyError("heading"))
    assert found.exit_code == 1
    assert found.stderr == (
        "Error: KeyError: 'heading'; this is a bug in automarine, please report it (-vv shows where)\n"
    )
    assert "Traceback" not in fails_with(KeyError("heading"), "-v").stderr
    assert "Traceback (most recent call last)" in fails_with(KeyError("heading"), "-vv").stderr


def test_trouble_of_the_machine_is_one_line() -> None:
    full = fails_with(OSError(28, "No space left on device"))
    assert (full.exit_code, full.stderr) == (
        1,
        "Error: [Errno 28] No space left on device; check the path, its permissions and the free disk space\n",
    )
    memory = fails_with(MemoryError())
    assert memory.exit_code == 1
    assert memory.stderr.startswith("Error: not enough memory; ")


def test_interrupt_is_130() -> None:
    found = fails_with(KeyboardInterrupt())
    assert (found.exit_code, found.stderr) == (130, "Interrupted; nothing was left half written.\n")


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
    _, said = process.communicate(timeout=600)
    assert (process.returncode, said) == (130, "Interrupted; nothing was left half written.\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("lines", [1, 100_000])
def test_closed_pipe_is_silent(lines: int) -> None:
    code = TRY.format(body=f"click.echo('x\\n' * {lines})")
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-c", code, "try"]
    found = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, cwd=ROOT, check=False)
    os.close(writer)
    assert (found.returncode, found.stderr) == (141, b"")


# What commands say


TABLE = "Drag\n\nmodel    k\n----------\n1      1.5\n"


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


def test_tables_then_where_the_files_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # a folder `out` of a demo would count
    found = say("-o", "out")
    assert found.stdout == TABLE + "\nOne.\nTwo.\n\nResults are in out: a.json\n"
    assert say().stdout.endswith("\nNo files were written; use -o DIR to save the results.\n")


def test_json_is_all_there_is_on_standard_output() -> None:
    for flags in (("--json",), ("--json", "-q"), ("--json", "-v", "-o", "out")):
        assert json.loads(say(*flags).stdout) == Outcome().to_json()


def test_runs_set_aside_are_counted_and_named() -> None:
    lines = say().stderr.splitlines()
    assert lines[:3] == [
        "Set aside: 12 runs",
        "  steps/a.csv, run r0, and 2 more: never moved",
        "  steps/a.csv, run r1: turned 0 degrees",
    ]
    assert lines[-1] == "  and 2 more (-v lists all)"
    loud = say("-v").stderr.splitlines()
    assert loud[0] == "read logs: 1"
    assert len(loud) == 14
    assert loud[2] == "  steps/a.csv, run r0: never moved"


def test_quiet_says_nothing() -> None:
    assert (say("-q").stdout, say("-q").stderr) == ("", "")


def test_bar_comes_late_and_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    from automarine_cli.commands import terminal as echo

    clock = iter([0.0, 0.5, 2.0, 2.05, 3.0, 3.1])
    said: list[str] = []
    monkeypatch.setattr(echo, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(echo.click, "echo", lambda text, **_: said.append(text))
    bar = echo.Bar()
    for done in range(5):
        bar("fit", done, 5)
    assert len(said) == 2  # at 2.0 and 3.0 s, not in the first second and not twice in a tenth
    assert said[-1].endswith("] 4/5")
    bar("fit", 5, 5)
    assert said[-1] == "\r\x1b[K"


def test_arm_must_be_a_length() -> None:
    command = click.command()(options.arm(lambda arm: click.echo(repr(arm))))
    assert CliRunner().invoke(command, ["--arm", "0.44"]).stdout == "0.44\n"
    for bad in ("0", "-1", "nan", "inf", "x"):
        assert CliRunner().invoke(command, ["--arm", bad]).exit_code == 2


# Help texts and examples


def test_list_of_commands_is_what_the_commands_say() -> None:
    """It is read off their files: importing all of them would take longer than importing click."""
    listed = python("--help", code=LIST_LOADED).stdout
    for name, command in commands().items():
        assert f"  {name} " in listed and command.short_help and command.short_help in listed
    assert listed.splitlines()[-1] == "[]"


@EVERY_COMMAND
def test_help_ends_with_an_example_that_parses(name: str) -> None:
    command = command_called(name)
    found = examples(command)
    assert found, f"the help of {name or 'automarine'} has no line `automarine ...` after `Example:`"
    assert CliRunner().invoke(command, ["--help"]).exit_code == 0
    assert not name or found[-1][0] == name  # what comes before makes the files that it needs
    for arguments in found:
        try:
            commands()[arguments[0]].make_context(arguments[0], arguments[1:])
        except click.BadParameter as problem:  # a file that another example makes
            assert "does not exist" in problem.message


@pytest.mark.parametrize("name", commands())
def test_options_say_what_they_do_and_the_shared_ones_are_there(name: str) -> None:
    params = commands()[name].params
    for param in params:
        assert not isinstance(param, click.Option) or param.help, f"{name}: {param.opts} has no help"
    flags = {flag for param in params for flag in param.opts}
    shared = {"--json", "-q", "-v"}
    if any(param.name == "logs" for param in params):
        shared |= {"--columns", "--jobs"}
    if "--out" in flags:
        shared |= {"-o", "--overwrite"}
    assert shared <= flags
