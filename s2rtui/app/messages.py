"""What workers tell the application."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from textual.message import Message


@dataclass
class LoadCompleted(Message):
    """Fields of `Resources` from a feed; `ticket` numbers the request, the newest one counts.

    `partly` means that more is to come.
    """

    feed: str
    ticket: int
    fields: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    partly: bool = False


@dataclass
class LoadProgressed(Message):
    """The share of a feed's work that is done."""

    feed: str
    ticket: int
    share: float


@dataclass
class BackgroundFailed(Message):
    """A work in the background ended by a fault."""

    text: str
