"""Runs feeds for an application, each in a thread of its own: the newest request wins."""

from __future__ import annotations

import traceback
from asyncio import TimerHandle
from dataclasses import dataclass, field
from functools import partial

from s2rstore.errors import S2RError
from s2rstore.reader import Store
from s2rtui.app.call_later import later
from s2rtui.app.controllers.base import Desk
from s2rtui.app.messages import BackgroundFailed, LoadCompleted, LoadProgressed
from s2rtui.jobs.background_thread import Lane
from s2rtui.loaders import LOADERS, Fields, Key, Loader
from s2rtui.session.state import State

REST_SECONDS = 0.15
AWAY_SECONDS = 120.0
"""How long what a feed holds is kept after it was wanted last."""


@dataclass
class RestartedLoads:
    """Feeds that were asked anew, and the fields that are empty from now on."""

    anew: set[str] = field(default_factory=set)
    emptied: Fields = field(default_factory=dict)


class LoadScheduler:
    """The requests under way: per feed the one that is read, and the newest one."""

    def __init__(self, app: Desk) -> None:
        self.app = app
        self._lanes = {feed.name: Lane(feed.name, partial(self._raised, feed)) for feed in LOADERS}
        self._wanted: dict[str, Key | None] = {}
        self._ticket: dict[str, int] = {feed.name: 0 for feed in LOADERS}
        self._answered: dict[str, int] = {feed.name: 0 for feed in LOADERS}
        self._rest: dict[str, TimerHandle] = {}
        self._away: dict[str, TimerHandle] = {}
        self.rest_seconds, self.away_seconds = REST_SECONDS, AWAY_SECONDS

    @property
    def idle(self) -> bool:
        """Whether no thread reads anything, or is about to."""
        return not self._rest and all(lane.idle for lane in self._lanes.values())

    @property
    def settled(self) -> bool:
        """Whether all that was wanted has come."""
        return self._answered == self._ticket

    def ask(self, store: Store, state: State) -> RestartedLoads:
        """Start what the state wants anew."""
        asked = RestartedLoads()
        for feed in LOADERS:
            wanted = feed.wants(store, state)
            if feed.name in self._wanted and wanted == self._wanted[feed.name]:
                continue
            asked.anew.add(feed.name)
            self._wanted[feed.name] = wanted
            self._ticket[feed.name] += 1
            for timers in (self._rest, self._away):
                if feed.name in timers:
                    timers.pop(feed.name).cancel()
            if wanted is None:
                self._answered[feed.name] = self._ticket[feed.name]
                asked.emptied.update(dict.fromkeys(feed.empty))
                self._let_go(feed)
            else:
                self._start(feed, self._ticket[feed.name], store, state)
        return asked

    def _start(self, feed: Loader, ticket: int, store: Store, state: State) -> None:
        read = partial(self._read, feed, ticket, store, state)
        if not feed.rests:
            self._lanes[feed.name].put(read)
            return

        def rested() -> None:
            if self.current(feed.name, ticket):
                del self._rest[feed.name]  # a timer keeps what it calls, and with it the store
                self._lanes[feed.name].put(read)

        self._rest[feed.name] = later(self.app, self.rest_seconds, rested)

    def _let_go(self, feed: Loader) -> None:
        """Have a feed leave after a while in which nothing of it is wanted."""
        if feed.leave is not None and self._lanes[feed.name].begun:
            leave = partial(self._lanes[feed.name].put, feed.leave)
            self._away[feed.name] = later(self.app, self.away_seconds, leave)

    def _read(self, feed: Loader, ticket: int, store: Store, state: State) -> None:
        """In the feed's thread."""
        caller = _Caller(self, feed, ticket)
        if not caller.wanted():
            return
        try:
            fields = feed.read(store, state, caller)
        except Exception as error:  # whatever it was, the screen goes on and says so
            empty = dict.fromkeys(feed.empty)
            told = str(error) or type(error).__name__
            if not isinstance(error, S2RError | OSError | ValueError):
                self.app.log.error(traceback.format_exc())
                told = f"{feed.name}: {told}"
            self.app.post(LoadCompleted(feed.name, ticket, empty, " ".join(told.split())))
            return
        self.app.post(LoadCompleted(feed.name, ticket, fields))

    def _raised(self, feed: Loader, error: Exception) -> None:
        """In the feed's thread: what was done in it beside reading."""
        self.app.post(BackgroundFailed(f"{feed.name}: {type(error).__name__}: {error}"))

    def current(self, feed: str, ticket: int) -> bool:
        """Whether a ticket is that of the newest request."""
        return ticket == self._ticket[feed]

    def stop(self) -> None:
        """Nothing is wanted any more; nobody waits for what is under way."""
        for feed in LOADERS:
            self._ticket[feed.name] += 1
            self._lanes[feed.name].end(feed.leave)

    def accept(self, message: LoadCompleted) -> bool:
        """Whether an answer is to the newest request, or a part that may be older."""
        if not self.current(message.feed, message.ticket):
            return message.partly and self._wanted[message.feed] is not None
        if not message.partly:
            self._answered[message.feed] = message.ticket
        return True


class _Caller:
    """One request of one feed, in the feed's thread."""

    def __init__(self, feeding: LoadScheduler, feed: Loader, ticket: int) -> None:
        self._feeding, self._feed, self._ticket = feeding, feed, ticket

    def wanted(self) -> bool:
        return self._feeding.current(self._feed.name, self._ticket)

    def progress(self, share: float) -> bool:
        wanted = self.wanted()
        if wanted and share < 1:
            self._feeding.app.post(LoadProgressed(self._feed.name, self._ticket, share))
        return wanted

    def bring(self, fields: Fields) -> None:
        if self._feed.follows or self.wanted():
            self._feeding.app.post(
                LoadCompleted(self._feed.name, self._ticket, fields, partly=True)
            )
