"""The interface of a loader: it reads data for the views in a background thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from s2rstore.reader import Store
from s2rtui.session.state import State

Key = tuple[object, ...]
Fields = dict[str, Any]


class LoadContext:
    """The request that a loader works for; by default one that nothing cancels or follows."""

    def is_current(self) -> bool:
        """Whether no newer request has replaced this one."""
        return True

    def report_progress(self, share: float) -> bool:
        """Report the share (0 .. 1) of the work that is done; False if it should stop."""
        return True

    def publish(self, fields: Fields) -> None:
        """Show a part of the result ahead of the rest."""


@dataclass(frozen=True, slots=True)
class Loader:
    """`request_key` returns a key of everything the result depends on, None if it is not needed.

    `read` returns fields of `LoadedData`. `cleared_fields` are set to None while nothing is needed.
    `is_debounced` waits for a pause in the input. With `shows_outdated`, partial results are shown
    although a newer request waits. `release` frees the resources of reading, some time after the
    last request. Each loader has one thread, which reads one request at a time.
    """

    name: str
    request_key: Callable[[Store, State], Key | None]
    read: Callable[[Store, State, LoadContext], Fields]
    cleared_fields: tuple[str, ...] = ()
    is_debounced: bool = True
    shows_outdated: bool = False
    release: Callable[[], None] | None = None
