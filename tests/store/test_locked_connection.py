"""An index is opened by several threads at once."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from s2rstore.files import layout
from s2rstore.index import locked_connection


def test_threads_open_one_index_at_once(tiny_store: Path) -> None:
    index = tiny_store / layout.read_current(tiny_store).index
    together = threading.Barrier(4)

    def opened(_: int) -> tuple[object, ...] | None:
        together.wait(30)
        connection = locked_connection.connect(index, "128MB")
        together.wait(30)
        found = connection.execute("SELECT current_setting('lock_configuration')").fetchone()
        connection.close()
        return found

    with ThreadPoolExecutor(4) as pool:
        for _ in range(20):
            assert list(pool.map(opened, range(4))) == [(True,)] * 4
