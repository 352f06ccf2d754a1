"""`python -m automarine_cli` is the console script `automarine`."""

from automarine_cli.pipeline import interrupts


def main() -> None:
    """The console script: heeds interrupts from here on, while the commands are still being loaded, to the end."""
    interrupts.heed()
    try:
        from automarine_cli.commands import main as command_line

        command_line()
    except KeyboardInterrupt:  # outside of any command
        interrupts.tell()
        interrupts.end()
    except SystemExit as done:
        if done.code == interrupts.INTERRUPTED:
            interrupts.end()
        raise
    finally:
        interrupts.disregard()


if __name__ == "__main__":
    main()
