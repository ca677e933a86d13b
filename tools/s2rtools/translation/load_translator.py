"""Load a translator from a file or, by its name, from a store."""

from __future__ import annotations

from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.translation.translator_file import StoredTranslator, open_stored, read_translator


def load_translator(text: str, store: Path | None = None) -> StoredTranslator:
    """The translator of a file, or of a store by its name. Raises RequestError."""
    path = Path(text)
    if store is None and not path.suffix and not path.exists():
        raise RequestError(f"{text}: no such file; a translator's name needs --store")
    if store is None or path.suffix == ".safetensors":
        return read_translator(path)
    with s2rstore.open(store) as opened:
        sha256 = opened.translator(text).sha256
    return open_stored(store, sha256)
