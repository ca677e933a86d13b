"""Taking back a night that should never have been written, as of a clock that was reset."""

from __future__ import annotations

import datetime

from s2rstore.errors import RequestError
from s2rstore.files import locks
from s2rstore.gap_history import reader
from s2rstore.gap_history.reader import Night
from s2rtools.nightly import history_writer as writing
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.publish import LATEST, check_own, publish
from s2rtools.nightly.run import Clock, check_writable, utc_now


def withdraw(
    config: NightlyConfig, night: datetime.date, clock: Clock = utc_now
) -> tuple[Night, ...]:
    """Move the rows of one night to the table `withdrawn`, and publish the newest night left.

    Readers of the history no longer see the night, and evidence is no longer dated by it. Its
    report files stay where they are. Gives the withdrawn rows. Raises RequestError where the
    history has no such night.
    """
    check_writable(config)
    check_own(config)
    if not config.history.exists():
        raise RequestError(f"{config.history}: no history, so no night to withdraw")
    with locks.file_lock(config.history):
        found = reader.read(config.history)
        gone = tuple(n for n in found.nights if (n.name, n.night) == (config.name, night))
        if not gone:
            newest = found.counting(config.name)
            known = f"the newest is {newest[-1].night}" if newest else "it has none"
            raise RequestError(f"{config.history}: no night {night} of {config.name!r}; {known}")
        now = clock().astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        writing.move(config.history, config.name, night, now)
        left = reader.read(config.history)
        nights = left.counting(config.name)
        if nights:
            publish(config, left, nights[-1])
        elif (config.reports / LATEST).is_symlink():
            (config.reports / LATEST).unlink()
    return gone
