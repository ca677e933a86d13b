"""Runs feeds in worker threads for an application: newest request wins, nothing blocks."""

from __future__ import annotations

from functools import partial
from typing import Any

from textual.app import App
from textual.timer import Timer

from s2rstore.errors import S2RError
from s2rstore.reader import Store
from s2rtui.feeds import FEEDS, REST_SECONDS, Feed, Key
from s2rtui.messages import Fed, Progressed
from s2rtui.session.state import State


class Feeding:
    """The requests under way, one per feed."""

    def __init__(self, app: App[Any]) -> None:
        self._app = app
        self._wanted: dict[str, Key | None] = {}
        self._ticket: dict[str, int] = {feed.name: 0 for feed in FEEDS}
        self._answered: dict[str, int] = {feed.name: 0 for feed in FEEDS}
        self._rest: dict[str, Timer] = {}
        self.rest_seconds = REST_SECONDS

    @property
    def settled(self) -> bool:
        """Whether all that was wanted has come."""
        return self._answered == self._ticket

    def ask(self, store: Store, state: State) -> dict[str, Any]:
        """Start what the state wants anew; gives the fields that are empty from now on."""
        emptied: dict[str, Any] = {}
        for feed in FEEDS:
            wanted = feed.wants(store, state)
            if feed.name in self._wanted and wanted == self._wanted[feed.name]:
                continue
            self._wanted[feed.name] = wanted
            self._ticket[feed.name] += 1
            if feed.name in self._rest:
                self._rest[feed.name].stop()
            if wanted is None:
                self._answered[feed.name] = self._ticket[feed.name]
                emptied.update(dict.fromkeys(feed.empty))
                continue
            start = partial(self._start, feed, self._ticket[feed.name], store, state)
            if feed.rests:
                self._rest[feed.name] = self._app.set_timer(self.rest_seconds, start)
            else:
                start()
        return emptied

    def _start(self, feed: Feed, ticket: int, store: Store, state: State) -> None:
        read = partial(self._read, feed, ticket, store, state)
        self._app.run_worker(read, group=feed.name, thread=True, exclusive=True)

    def _read(self, feed: Feed, ticket: int, store: Store, state: State) -> None:
        """In a worker's thread."""

        def told(share: float) -> bool:
            current = ticket == self._ticket[feed.name]
            if current and share < 1:
                self._app.post_message(Progressed(feed.name, ticket, share))
            return current

        if ticket != self._ticket[feed.name]:
            return
        try:
            fields = feed.read(store, state, told)
        except (S2RError, OSError, ValueError) as error:
            empty = dict.fromkeys(feed.empty)
            self._app.post_message(Fed(feed.name, ticket, empty, str(error)))
            return
        self._app.post_message(Fed(feed.name, ticket, fields))

    def accept(self, message: Fed) -> bool:
        """Whether an answer is to the newest request."""
        if message.ticket != self._ticket[message.feed]:
            return False
        self._answered[message.feed] = message.ticket
        return True
