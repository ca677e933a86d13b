"""One night: measure what is new, keep it, tell it. The same night again changes nothing."""

from __future__ import annotations

import datetime
import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from s2rstore.errors import InconclusiveError, RequestError, StoreBusyError
from s2rstore.files import locks
from s2rstore.gap_history import reader as stored
from s2rstore.gap_history.reader import Night
from s2rstore.reader import Store
from s2rtools.nightly import history_writer, input_fingerprint, measurement
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.history_writer import Tonight
from s2rtools.nightly.input_fingerprint import Inputs
from s2rtools.nightly.measurement import Estimates, Estimating, Measuring, Report, refused
from s2rtools.nightly.publish import check_own, publish

Clock = Callable[[], datetime.datetime]
MOST_BACK = 31
"""Days before the newest night that a night may be: what is still filled in later."""
MOST_AHEAD = 366
"""Days after it: a gate that paused for a year. Clocks that were reset are years off."""


@dataclass(frozen=True, slots=True)
class Done:
    """The row that counts for the night; `new` where it was added, `computed` where measured."""

    night: Night
    new: bool
    computed: bool
    written: tuple[Path, ...]


def utc_now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


def nightly(
    config: NightlyConfig,
    night: datetime.date,
    measure: Measuring = measurement.measured,
    estimate: Estimating = measurement.estimated,
    clock: Clock = utc_now,
    far: bool = False,
) -> Done:
    """A night that cannot be measured is kept as refused, with the reason.

    Raises RequestError, before anything is written, for a store or files that cannot be read,
    places that cannot be written or belong to another gate, and a night that is far from the
    newest one, unless `far` admits it.
    """
    check_writable(config)
    check_own(config)
    if not far:
        _check_near(config, night)
    tonight = _figures(config, night, measure, estimate)
    stored.check_place(config.history)
    config.history.parent.mkdir(parents=True, exist_ok=True)
    with locks.file_lock(config.history):
        found = history_writer.known(config.history)
        present = history_writer.last_of(found, config.name, night)
        new = not history_writer.tells(present, tonight, found)
        if new:
            history_writer.append(config.history, history_writer.rows(tonight, found, clock()))
            found = stored.read(config.history)
            present = history_writer.last_of(found, config.name, night)
        assert present is not None
        written = publish(config, found, present)
    return Done(present, new, new and present.measured == present.id, tuple(written))


def _check_near(config: NightlyConfig, night: datetime.date) -> None:
    """RequestError for a date that looks like that of a clock which was reset.

    Evidence is as old as the first night that saw it, so one such night would make the evidence of
    all others stale.
    """
    nights = history_writer.known(config.history).counting(config.name)
    if not nights or any(each.night == night for each in nights):
        return
    newest = nights[-1].night
    if not -MOST_BACK <= (night - newest).days <= MOST_AHEAD:
        raise RequestError(
            f"{config.source}: night {night} is far from the newest, {newest}; is the clock right? "
            f"--far-night admits it, --withdraw {newest} takes the newest back"
        )


def _figures(
    config: NightlyConfig, night: datetime.date, measure: Measuring, estimate: Estimating
) -> Tonight:
    """Tonight's figures: those of the same key, where there are some."""
    store, current = input_fingerprint.open_store(config.store)
    with store:
        inputs = input_fingerprint.inputs(config, store, current)
        measured = history_writer.measurement(history_writer.known(config.history), inputs.key)
        if measured is not None:
            report = json.loads(stored.report_text(config.history, measured))
            return Tonight(config, inputs, night, report, measured=measured)
        report, estimates = _measured(store, config, inputs, measure, estimate)
        if input_fingerprint.inputs(config, store, current) != inputs:
            raise RequestError(
                f"{config.source}: what it measures changed meanwhile; nothing is written, "
                "start it again"
            )
    return Tonight(config, inputs, night, report, estimates)


def _measured(
    store: Store, config: NightlyConfig, inputs: Inputs, measure: Measuring, estimate: Estimating
) -> tuple[Report, Estimates]:
    try:
        return measure(store, config), estimate(config.sysid) if config.sysid else ()
    except StoreBusyError:
        raise
    except (InconclusiveError, RequestError) as error:
        return refused(store, config, inputs, error), ()


def check_writable(config: NightlyConfig) -> None:
    """Before anything is measured: whether all that will be written can be."""
    places = {"history": config.history.parent, "reports": config.reports}
    if config.metrics is not None:
        places["metrics"] = config.metrics.parent
    for name, folder in places.items():
        there = next(each for each in (folder, *folder.parents) if each.exists())
        if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
            raise RequestError(f"{config.source}: output.{name}: {there} cannot be written in")
