"""`python -m bench.scale_probe STORE`: one process, one store; a JSON line per measurement.

Times are the shortest of three, each with the masks of earlier selections forgotten. Drawn means
the application as it runs, on a terminal of 200 x 60 that keeps nothing: from the change to the
last escape code.
"""

from __future__ import annotations

import asyncio
import json
import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from textual.drivers.headless_driver import HeadlessDriver

from bench import scale_steps as steps
from s2rstore.recent import Recent
from s2rtui.app import S2RApp
from s2rtui.canvas import Look
from s2rtui.session import Session, listing
from s2rtui.widgets import PlotView

_TIMES = 3
_MASKS = 128 * 2**20


class Sink(HeadlessDriver):
    """A terminal that counts what it is sent."""

    received = 0

    @property
    def is_headless(self) -> bool:
        """Not, so that the application encodes what it draws."""
        return False

    def write(self, data: str) -> None:
        Sink.received += len(data.encode())


def resident() -> float:
    """MB of this process that are in memory."""
    found = re.search(r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text())
    return int(found[1]) / 1024 if found else float("nan")


def clocked(work: Callable[[], object]) -> float:
    """Seconds."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def shortest(rounds: Sequence[Sequence[float]]) -> list[float]:
    """Per step, over several rounds of the same steps."""
    return [min(taken) for taken in zip(*rounds, strict=True)]


def tell(name: str, value: float, unit: str) -> None:
    print(json.dumps([name, value, unit]), file=sys.__stdout__, flush=True)


def spread(name: str, taken: Iterable[float]) -> None:
    """The median and the worst of some times in seconds."""
    times = sorted(taken)
    tell(f"{name}, median", 1e3 * median(times), "ms")
    tell(f"{name}, worst", 1e3 * times[-1], "ms")


class Probe:
    """The application on one store, its clock and its memory."""

    def __init__(self, path: Path) -> None:
        self.loaded = resident()
        began = time.perf_counter()
        self.session = Session(path)
        tell("open to the first state", 1e3 * (time.perf_counter() - began), "ms")
        self.app = S2RApp(self.session, Look())
        self.app.driver_class = Sink

    async def all(self) -> None:
        running = asyncio.create_task(self.app.run_async(headless=False, size=steps.SIZE))
        began = time.perf_counter()
        await self.settle()
        tell("all views there and feeds at rest", 1e3 * (time.perf_counter() - began), "ms")
        self.remember("with the first run open")
        with self.app._context():  # timers that changes start belong to the application
            self.numbers()
            await self.drawing()
            await self.moving()
        self.remember("after all runs and views")
        self.app.exit()
        await running

    async def settle(self) -> None:
        """Until nothing is drawn or fetched any more."""
        await asyncio.sleep(0.2)
        limit = time.monotonic() + 60
        while not (self.app.is_running and self.app.settled):
            assert time.monotonic() < limit, "the feeds never come to rest"
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.1)

    def remember(self, when: str) -> None:
        tell(f"memory {when}, beside the libraries", resident() - self.loaded, "MB")

    def forget(self) -> None:
        """All selected, and no mask kept."""
        self.session.store.evaluated = Recent(_MASKS)
        self.session.select("all")

    def numbers(self) -> None:
        """State and numbers of a series of selections."""
        rounds: list[list[tuple[float, float]]] = []
        series = steps.selections(self.session)
        for _ in range(_TIMES):
            self.forget()
            steps.numbers(self.app.scene)
            rounds.append([(clocked(step), clocked(self._count)) for _, step in series])
        state, counted = (shortest([[pair[i] for pair in r] for r in rounds]) for i in (0, 1))
        for (name, _), *times in zip(series, state, counted, strict=True):
            print(f"{name[:50]:<50}", *(f"{1e3 * t:8.2f}" for t in times), file=sys.__stderr__)
        both = [sum(times) for times in zip(state, counted, strict=True)]
        spread("selection change, state and all views' numbers", both)

    def _count(self) -> None:
        steps.numbers(self.app.scene)

    async def drawing(self) -> None:
        """The same drawn, then marks that move."""
        series = [step for _, step in steps.selections(self.session)]
        before = Sink.received
        spread("selection change, drawn, encoded", await self.rounds(series, self.forget))
        sent = (Sink.received - before) / len(series) / _TIMES
        tell("selection change, bytes", sent, "bytes")
        start = partial(self.session.set, self.session.select("worst15"))
        for view, panel in (("map", "map"), ("umap", "real")):
            for lasso in (False, True):
                taken = await self.rounds(steps.brushed(self.app, view, panel, lasso), start)
                spread(f"{'lasso' if lasso else 'box'} moved on the {view}, drawn", taken)

    async def moving(self) -> None:
        """All other keys."""
        fresh = [lambda: self.session.change_run(1)] * (len(self.session.state.runs) - 1)
        spread("run not seen before, drawn", [self.draw(step) for step in fresh])
        await self.settle()
        start = partial(self.session.set, self.session.select("worst15"))
        for name, work in steps.moves(self.session).items():
            spread(f"{name}, drawn", await self.rounds(work, start))
            await self.settle()
        start()
        spread("list sorted by another column", self.sorting())

    def sorting(self) -> list[float]:
        taken = []
        for _ in range(4):
            listing.next_column(self.session)
            taken.append(clocked(steps.ordered(self.session)))
        return taken

    async def rounds(
        self, work: Sequence[Callable[[], object]], before: Callable[[], Any]
    ) -> list[float]:
        """The steps several times, each time from the same state."""
        taken = []
        for _ in range(_TIMES):
            before()
            self.app.refresh_views()
            await asyncio.sleep(0.3)
            one = []
            for step in work:
                one.append(self.draw(step))
                await asyncio.sleep(0.03)
            taken.append(one)
        return shortest(taken)

    def draw(self, work: Callable[[], object]) -> float:
        """Change, draw, and write what changed."""

        def change() -> None:
            work()
            self.app.refresh_views()
            screen = self.app.screen
            screen._compositor.update_widgets(set(self.app.query(PlotView)))
            screen._compositor_refresh()

        return clocked(change)


if __name__ == "__main__":
    asyncio.run(Probe(Path(sys.argv[1])).all())
