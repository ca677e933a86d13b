"""Withdraw a night that was recorded by mistake, for example under a wrong clock."""

from __future__ import annotations

import datetime

from s2rstore.errors import RequestError
from s2rstore.files import locks
from s2rstore.gap_history import reader, writer
from s2rstore.gap_history.reader import Night
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.publish import LATEST, check_ownership, publish
from s2rtools.nightly.run import Clock, check_writable, utc_now


def withdraw(
    config: NightlyConfig, night: datetime.date, clock: Clock = utc_now
) -> tuple[Night, ...]:
    """Move the rows of a night to the table `withdrawn`, and publish the newest remaining night.

    Readers of the history no longer see the night, and the age of evidence no longer counts it. Its
    report files remain. Returns the withdrawn rows. Raises RequestError where the history has no
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
