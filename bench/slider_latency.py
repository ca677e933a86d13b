"""Latency from a key press on a slider to the drawn prediction.

`python -m bench.slider_latency STORE --run R` measures with an existing store.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import sys
import time
from pathlib import Path

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.canvas import RenderOptions
from s2rtui.session.session import Session

_LOADING = 120.0


def milliseconds(store: Path, run: str | None = None, moves: int = 15) -> list[float]:
    """Time of each move of the brightness slider until images and prediction are drawn."""
    return asyncio.run(_measured(store, run, moves))


async def _measured(store: Path, run: str | None, moves: int) -> list[float]:
    app = S2RApp(Session(store, run), RenderOptions())
    latencies: list[float] = []
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await app.run_action("do('adjust')")
        await _until(app, None, _LOADING)
        await settle(app, pilot)
        for _ in range(moves):
            before = app.loaded.live
            began = time.perf_counter()
            await app.run_action("do('more')")
            await _until(app, before, 10.0)
            latencies.append(1e3 * (time.perf_counter() - began))
            await settle(app, pilot)
    return latencies


async def _until(app: S2RApp, before: object, patience: float) -> None:
    """Wait for another live result, which is drawn in the same iteration of the event loop."""
    limit = time.monotonic() + patience
    while app.loaded.live is before:
        if time.monotonic() > limit:
            raise TimeoutError(app.session.state.message or "no prediction came")
        await asyncio.sleep(0.001)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.slider_latency", description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--run")
    options = parser.parse_args()
    latencies = milliseconds(options.store, options.run)
    print(f"median {statistics.median(latencies):.0f} ms, largest {max(latencies):.0f} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())
