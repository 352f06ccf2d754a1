"""`python -m automarine_cli` is the console script `automarine`."""

from automarine_cli.cli import main

if __name__ == "__main__":
    main()
