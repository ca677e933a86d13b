"""How soon something useful is there."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from bench.figures import Figure, seconds

_IMPORTS = "import textual.app, numpy, duckdb"
_PAINT = """
import asyncio, os, sys
from pathlib import Path
from s2rtui.app import S2RApp
from s2rtui.canvas import Look
from s2rtui.session import Session
async def main():
    app = S2RApp(Session(Path(sys.argv[1])), Look())
    async with app.run_test(size=(120, 40)) as pilot:
        strips = app.screen._compositor.render_strips()
        assert any("overview" in strip.text for strip in strips)
        os._exit(0)  # it is on the screen; what workers still bring is not waited for
asyncio.run(main())
"""


def figures(store: Path) -> Iterator[Figure]:
    """Command line and first paint, each in a process of its own."""
    code = [sys.executable, "-c"]

    def run(*words: str) -> None:
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)

    yield Figure(
        "s2r --help", seconds(lambda: run(sys.executable, "-m", "s2rtui", "--help")), "s", 0.5
    )
    plain = seconds(lambda: run(*code, _IMPORTS))
    paint = seconds(lambda: run(*code, _PAINT, str(store)))
    yield Figure("import textual.app, numpy, duckdb", plain, "s")
    yield Figure("first useful paint", paint, "s")
    yield Figure("first useful paint / imports", paint / plain, "ratio", 2.0)
