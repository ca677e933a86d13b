"""What reaches the application while it is used: answers of feeds, newer generations, nights."""

from __future__ import annotations

from dataclasses import replace

from s2rstore.errors import RequestError, S2RError
from s2rstore.reader import Store
from s2rtui.app.controllers.run_save import Savings
from s2rtui.app.load_scheduler import LoadScheduler
from s2rtui.app.messages import LoadCompleted, LoadProgressed
from s2rtui.session import navigation, pending_target


class LoadResultHandler:
    """Takes it in for an application: the session moves, views are drawn anew, trouble is told."""

    def __init__(self, app: Savings, feeding: LoadScheduler) -> None:
        self._app = app
        self._feeding = feeding
        self._trouble = ""

    def fed(self, message: LoadCompleted) -> None:
        """An answer; one that nobody waits for any more is dropped."""
        app, fresh = self._app, message.fields.pop("store", None)
        if not self._feeding.accept(message):
            if fresh is not None:
                fresh.close()
            return
        if message.feed == "run":
            self._run(message, fresh)
        elif message.error:
            app.session.tell(message.error, is_error=True)
        app.resources = app.resources.with_loaded(message.feed, message.fields, message.error)
        app.refresh_views()

    def _run(self, message: LoadCompleted, fresh: Store | None) -> None:
        """The awaited run is read, or cannot be."""
        app = self._app
        try:
            if message.error:
                raise RequestError(message.error)
            navigation.arrive(app.session, fresh)
            app.tell_saved()
        except S2RError as error:
            pending_target.give_up(app.session)
            app.session.tell(str(error), is_error=True)

    def progressed(self, message: LoadProgressed) -> None:
        """How far a feed is."""
        if not self._feeding.current(message.feed, message.ticket):
            return
        resources = self._app.resources
        progress = {**resources.progress, message.feed: message.share}
        self._app.resources = replace(resources, progress=progress)
        self._app.show_message()

    def watch(self) -> None:
        """Let go what nobody reads, and look for what others have published."""
        session = self._app.session
        if self._feeding.idle and not self._app.under_way:
            session.release()
        noticed, trouble = False, ""
        try:
            noticed = session.notice()
        except (S2RError, OSError) as error:
            trouble = str(error)
        if trouble != self._trouble:
            self._tell(trouble)
        if noticed:
            self._app.refresh_views()

    def _tell(self, trouble: str) -> None:
        """A store that is out of reach, once; and that it is no more."""
        session, before, self._trouble = self._app.session, self._trouble, trouble
        if trouble:
            session.tell(trouble, is_error=True)
        elif session.state.is_error and session.state.message == before:
            session.tell("")
        self._app.show_message()
