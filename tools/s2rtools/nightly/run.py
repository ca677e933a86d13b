"""One night: measure, record, publish, or withdraw. Running a night again changes nothing."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from s2rstore.errors import InconclusiveError, RequestError, StoreBusyError
from s2rstore.files import locks
from s2rstore.gap_history import reader, writer
from s2rstore.gap_history.reader import History, Night
from s2rtools.common.result_files import check_folder
from s2rtools.nightly import input_fingerprint, measurement
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.measurement import Estimates, Estimating, Measuring
from s2rtools.nightly.night_record import NightResult, is_recorded, night_record
from s2rtools.nightly.publish import LATEST, check_ownership, publish

Clock = Callable[[], datetime.datetime]
MAX_DAYS_BACK = 31
"""Days that an added night may lie before the newest one without `--far-night`."""
MAX_DAYS_AHEAD = 366
"""Largest number of days after the newest night; clocks that were reset are years off."""


@dataclass(frozen=True, slots=True)
class NightRun:
    """The valid record of the night, whether it is `new`, and whether it was `computed` now."""

    night: Night
    new: bool
    computed: bool
    written: tuple[Path, ...]


def utc_now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


def nightly(
    config: NightlyConfig,
    night: datetime.date,
    measure: Measuring = measurement.measure_gap,
    estimate: Estimating = measurement.estimate_parameters,
    clock: Clock = utc_now,
    far: bool = False,
) -> NightRun:
    """Measure and publish a night; one that cannot be measured is recorded with the reason.

    Raises RequestError, before anything is written, for unreadable inputs, outputs that cannot be
    written or belong to another gate, and nights far from the newest one unless `far`.
    """
    check_writable(config)
    check_ownership(config)
    if not far:
        _check_date(config, night)
    result = _night_result(config, night, measure, estimate)
    reader.refuse_link(config.history)
    config.history.parent.mkdir(parents=True, exist_ok=True)
    with locks.file_lock(config.history) as lease:
        history = _read_or_empty(config.history)
        present = _valid_record(history, config.name, night)
        new = not is_recorded(present, result, history)
        if new:
            record = night_record(result, history, clock())
            report = None
            if result.measured is None:
                report = json.dumps(result.report, indent=1, sort_keys=True, allow_nan=False)
            writer.append(config.history, record, report, lease.check)
            history = reader.read(config.history)
            present = _valid_record(history, config.name, night)
        assert present is not None
        lease.check()
        written = publish(config, history, present)
    return NightRun(present, new, new and present.measured == present.id, tuple(written))


def withdraw(
    config: NightlyConfig, night: datetime.date, clock: Clock = utc_now
) -> tuple[Night, ...]:
    """Mark the records of a night as withdrawn, and publish the newest remaining night.

    Readers of the history no longer see the night, and the age of evidence no longer counts it. Its
    report files remain. Returns the withdrawn records. Raises RequestError where the history has no
    such night.
    """
    check_writable(config)
    check_ownership(config)
    if not config.history.exists():
        raise RequestError(f"{config.history}: no history, so no night to withdraw")
    with locks.file_lock(config.history) as lease:
        history = reader.read(config.history)
        withdrawn = tuple(n for n in history.nights if (n.name, n.night) == (config.name, night))
        if not withdrawn:
            newest = history.of_configuration(config.name)
            known = f"the newest is {newest[-1].night}" if newest else "it has none"
            raise RequestError(f"{config.history}: no night {night} of {config.name!r}; {known}")
        now = clock().astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        writer.withdraw_night(config.history, config.name, night, now, lease.check)
        lease.check()
        remaining = reader.read(config.history)
        nights = remaining.of_configuration(config.name)
        if nights:
            publish(config, remaining, nights[-1])
        elif (config.reports / LATEST).is_symlink():
            (config.reports / LATEST).unlink()
    return withdrawn


def _read_or_empty(path: Path) -> History:
    return reader.read(path) if path.exists() else History()


def _valid_record(history: History, name: str, night: datetime.date) -> Night | None:
    """The last record of a night; None if there is none."""
    return next((each for each in history.of_configuration(name) if each.night == night), None)


def _check_date(config: NightlyConfig, night: datetime.date) -> None:
    """Raises RequestError for a date that suggests a clock that was reset.

    Evidence is dated by the first night that used it, so one wrong date would make the evidence of
    all other nights stale.
    """
    nights = _read_or_empty(config.history).of_configuration(config.name)
    if not nights or any(each.night == night for each in nights):
        return
    newest = nights[-1].night
    if not -MAX_DAYS_BACK <= (night - newest).days <= MAX_DAYS_AHEAD:
        raise RequestError(
            f"{config.source}: night {night} is far from the newest, {newest}; check the clock, "
            f"accept the date with --far-night, or withdraw the newest with --withdraw {newest}"
        )


def _night_result(
    config: NightlyConfig, night: datetime.date, measure: Measuring, estimate: Estimating
) -> NightResult:
    """The result of a night; figures of a night with the same key are reused."""
    store, current = input_fingerprint.open_store(config.store)
    with store:
        inputs = input_fingerprint.inputs(config, store, current)
        nights = _read_or_empty(config.history).nights
        measured = next((n.measured for n in nights if n.key == inputs.key and not n.refused), None)
        if measured is not None:
            report = json.loads(reader.report_text(config.history, measured))
            return NightResult(config, inputs, night, report, measured=measured)
        estimates: Estimates = ()
        try:
            report = measure(store, config)
            estimates = estimate(config)
        except StoreBusyError:
            raise
        except (InconclusiveError, RequestError) as error:
            report = measurement.failed_report(store, config, inputs, error)
        if input_fingerprint.inputs(config, store, current) != inputs:
            raise RequestError(
                f"{config.source}: the inputs changed during the measurement; nothing was "
                "written, run it again"
            )
    return NightResult(config, inputs, night, report, estimates)


def check_writable(config: NightlyConfig) -> None:
    """Raises RequestError where an output cannot be written, before anything is measured."""
    folders = {"history": config.history.parent, "reports": config.reports}
    if config.metrics is not None:
        folders["metrics"] = config.metrics.parent
    for name, folder in folders.items():
        check_folder(f"{config.source}: output.{name}", folder)
