"""`automarine completion`: the name of a shell in, the lines that make it complete our commands out."""

from dataclasses import dataclass

import click

from automarine_cli.cli import options
from automarine_cli.cli.echo import echo_result

VARIABLE = "_AUTOMARINE_COMPLETE"


@dataclass(frozen=True)
class Completion:
    """The script for one shell."""

    shell: str
    script: str

    def to_json(self) -> dict[str, object]:
        """Schema automarine/completion/1."""
        return {"schema": "automarine/completion/1", "shell": self.shell, "script": self.script}


@click.command("completion", short_help="Print a shell completion script.")
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
@options.json_option
@options.verbosity
@click.pass_context
def completion(ctx: click.Context, shell: str, as_json: bool) -> object:
    """Print the script that makes a shell complete commands, options and file names.

    For bash put `eval "$(automarine completion bash)"` into ~/.bashrc, for zsh `eval "$(automarine completion zsh)"`
    into ~/.zshrc, and for fish `automarine completion fish | source` into ~/.config/fish/config.fish.

    \b
    Example:
      automarine completion bash
    """
    from click.shell_completion import get_completion_class

    found = get_completion_class(shell)
    assert found is not None
    script = found(ctx.find_root().command, {}, "automarine", VARIABLE).source()
    result = Completion(shell, script)
    if as_json:
        echo_result(result, as_json=True)
    else:
        click.echo(script)
    return result
