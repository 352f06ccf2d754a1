"""`python -m automarine_cli` is the console script `automarine`."""

import signal
import sys

STOP_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def main() -> None:
    """Run the console script: from here on Ctrl-C, SIGTERM and a hang-up end it in order, also while it loads."""
    for number in STOP_SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):  # not what nohup ignores
            signal.signal(number, _interrupt)
    try:
        from automarine_cli.commands import main as command_line

        command_line()
    except KeyboardInterrupt:  # outside of any command
        sys.stderr.write("Interrupted; nothing was left half written.\n")
        sys.exit(130)


def _interrupt(number: int, frame: object) -> None:
    for each in STOP_SIGNALS:  # the end has begun; impatience must not cut it short
        signal.signal(each, signal.SIG_IGN)
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
