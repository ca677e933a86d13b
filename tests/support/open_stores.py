"""Keep stores open, because DuckDB opens an index faster that its process has open."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import s2rstore


@contextmanager
def kept_open(store: Path) -> Iterator[Path]:
    """Keep the index of a store open that nobody modifies meanwhile."""
    with s2rstore.open(store) as opened:
        opened.execute("SELECT 1")
        yield store
