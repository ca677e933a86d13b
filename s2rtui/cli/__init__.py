"""The `s2r` command line: `main` runs one command; each command is a module of `cli.commands`."""

from s2rtui.cli.main import main

__all__ = ["main"]
