"""Where a night may write."""

from __future__ import annotations

from typing import TYPE_CHECKING

from s2rstore.errors import RequestError

if TYPE_CHECKING:
    from s2rtools.nightly.config import Config


def check_apart(config: Config) -> None:
    """Raises RequestError where a night would write over another file of its own, or no file."""
    taken = {config.source.resolve(), config.reference, config.golden, config.features}
    for name, path in {"history": config.history, "metrics": config.metrics}.items():
        where = f"{config.source}: output.{name}: {path}"
        if path is None:
            continue
        if path.exists() and not path.is_file():
            raise RequestError(f"{where}: a folder or a device; name a file")
        if path in taken:
            raise RequestError(f"{where}: is another file of this gate; name one of its own")
        taken.add(path)
