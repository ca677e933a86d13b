"""Several threads open an index at once."""

import threading
from concurrent.futures import ThreadPoolExecutor

from s2rstore.files import layout
from s2rstore.index import locked_connection


def test_threads_open_an_index_simultaneously(tiny_store):
    index = tiny_store / layout.read_current(tiny_store).index
    barrier = threading.Barrier(4)

    def open_index(_: int) -> tuple[object, ...] | None:
        barrier.wait(30)
        connection = locked_connection.connect(index, "128MB")
        barrier.wait(30)
        setting = connection.execute("SELECT current_setting('lock_configuration')").fetchone()
        connection.close()
        return setting

    with ThreadPoolExecutor(4) as pool:
        for _ in range(20):
            assert list(pool.map(open_index, range(4))) == [(True,)] * 4
