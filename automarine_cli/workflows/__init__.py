"""One function a command, same file names as `cli/`; callable from Python, each returns its result object."""
