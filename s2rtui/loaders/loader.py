"""What a feed is: something that a worker brings when the state wants it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from s2rstore.reader import Store
from s2rtui.session.state import State

Key = tuple[object, ...]
Fields = dict[str, Any]


class LoadContext(Protocol):
    """Who asked: hears of progress, takes parts of the answer, may have lost interest."""

    def wanted(self) -> bool:
        """Whether the answer is still wanted."""

    def progress(self, share: float) -> bool:
        """Tell the share that is done; whether to go on."""

    def bring(self, fields: Fields) -> None:
        """A part of the answer, ahead of the rest."""


@dataclass(frozen=True, slots=True)
class Loader:
    """`wants` gives what the result depends on, None for nothing; `read` fields of `Resources`.

    `empty` is shown while nothing is wanted. A feed that `rests` waits until keys are at rest; of
    one that `follows` parts are shown although something newer is wanted. `leave` lets go what
    reading holds: at last, and after a while in which nothing is wanted. Each feed is read by one
    thread, one request at a time.
    """

    name: str
    wants: Callable[[Store, State], Key | None]
    read: Callable[[Store, State, LoadContext], Fields]
    empty: tuple[str, ...] = ()
    rests: bool = True
    follows: bool = False
    leave: Callable[[], None] | None = None
