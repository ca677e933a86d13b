"""Messages from background threads to the application."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from textual.message import Message

from s2rtui.jobs.precompute_job import JobProgress
from s2rtui.session.session import StoreUpdates


@dataclass
class LoadCompleted(Message):
    """A loader returned fields of `LoadedData`; `ticket` is the number of its request.

    `partial`: more fields of the same request follow.
    """

    loader: str
    ticket: int
    fields: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    partial: bool = False


@dataclass
class LoadProgressed(Message):
    """A loader has done a share (0 .. 1) of its work."""

    loader: str
    ticket: int
    share: float


@dataclass
class ExportProgressed(Message):
    """An export has a message; `finished` is its target once it is written or has failed."""

    text: str
    finished: Path | None = None
    is_error: bool = False


@dataclass
class AdjustmentProgressed(Message):
    """The computation of an adjustment that was saved as a run has advanced."""

    run: str
    progress: JobProgress


@dataclass
class StoreChecked(Message):
    """A background check found what is published now, or failed with an error."""

    updates: StoreUpdates | None
    error: str = ""


@dataclass
class BackgroundFailed(Message):
    """A background job ended with an unexpected error."""

    text: str
