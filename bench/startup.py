"""Start-up time, with modules compiled as in an installation."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from bench.budget import BudgetRow, seconds

_TIMES = 5
_IMPORTS = "import textual.app, numpy, duckdb"
_PAINT = """
import asyncio, gc, os, sys
gc.disable()  # as the command does until the application runs
from pathlib import Path
from s2rtui.app.app import S2RApp
from s2rtui.canvas import RenderOptions
from s2rtui.session.session import Session
session = Session(Path(sys.argv[1]))
gc.freeze()
gc.enable()
async def main():
    app = S2RApp(session, RenderOptions())
    async with app.run_test(size=(120, 40)) as pilot:
        strips = app.screen._compositor.render_strips()
        text = "\\n".join(strip.text for strip in strips)
        assert "worst room" in text and "shift" in text, text  # a finding and its map
        os._exit(0)  # the screen is complete; do not wait for workers
asyncio.run(main())
"""


def figures(store: Path) -> Iterator[BudgetRow]:
    """Measure the command line and the first paint, each in a new process."""
    with tempfile.TemporaryDirectory() as compiled:
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": compiled}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)

        def run(*words: str) -> None:
            command = [sys.executable, *words]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)

        help_seconds = seconds(lambda: run("-m", "s2rtui", "--help"))
        yield BudgetRow("s2r --help", help_seconds, "s", 0.5)
        taken: list[tuple[float, float]] = []
        for _ in range(_TIMES + 1):  # alternate, so that other load affects both
            began = time.perf_counter()
            run("-c", _IMPORTS)
            between = time.perf_counter()
            run("-c", _PAINT, str(store))
            taken.append((between - began, time.perf_counter() - between))
        plain, paint = (median(times) for times in zip(*taken[1:], strict=True))
        yield BudgetRow("import textual.app, numpy, duckdb", plain, "s")
        yield BudgetRow("first useful paint", paint, "s")
        yield BudgetRow("first useful paint / imports", paint / plain, "ratio", 2.0)
