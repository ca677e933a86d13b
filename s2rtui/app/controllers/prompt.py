"""What is typed: expressions, names of selections, notes and tags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from textual.widgets import Input

from s2rstore.errors import RequestError, S2RError
from s2rstore.language import ExpressionError, complete, evaluation
from s2rtui.app.controllers.base import Desk
from s2rtui.app.screens.selections import SelectionsScreen
from s2rtui.app.widgets.query_input import QueryInput
from s2rtui.jobs.precompute_job import save_run
from s2rtui.session import adjusting, display, shared_selection
from s2rtui.user_data.notebook import Remark, reference, valid_name

Accept = Callable[[str], object]
_OFFERS = 6
_MOST_TAGGED = 2000
"""Instances at a time; each becomes an entry of the notebook."""


class Prompts(Desk):
    """The actions that open the line at the foot, and what happens with its text."""

    _accept: Accept | None = None

    @property
    def prompting(self) -> bool:
        return self._accept is not None

    @property
    def _line(self) -> QueryInput:
        return self.query_one(QueryInput)

    def _ask(
        self, accept: Accept, value: str, hint: str, history: Sequence[str] = (), help: bool = False
    ) -> None:
        self._accept = accept
        self._line.open(value, hint, history, self._completions if help else None)

    def _completions(self, text: str) -> list[tuple[str, str]]:
        return complete(text, evaluation.vocabulary(self.session.store, self.session.notes.nodes))

    def close_prompt(self) -> None:
        """Leave the line, and what was told about it."""
        self.session.tell("")
        self._end_prompt()

    def _end_prompt(self) -> None:
        self._accept = None
        self._line.close()
        self.refresh_views()

    def action_edit(self) -> None:
        self._refresh_notes()
        state = self.session.state
        known = dict.fromkeys((*self.session.notes.history, *state.past, state.expression))
        take = partial(shared_selection.take, self.session)
        self._ask(take, state.expression, "worst15 & room:right", list(known), True)

    def _refresh_notes(self) -> None:
        """Take in what another session of this user has saved."""
        if self.session.notebook is not None:
            try:
                self.session.notebook.refresh()
            except S2RError as error:
                self.session.tell(str(error), is_error=True)

    def action_save_selection(self) -> None:
        self._ask(self._save, "", "a name for this selection: it becomes @name")

    def _save(self, name: str) -> None:
        self.session.book.save(name, shared_selection.present(self.session))
        self._tell_kept(f"saved as {reference(valid_name(name, 'name'))}")

    def _tell_kept(self, told: str) -> None:
        """Tell what is kept, unless the present selection cannot follow, which is told then."""
        before = self.session.state
        after = self.session.renew()
        if after is before or not after.is_error:
            self.session.tell(told)

    def _cursor(self, what: str) -> int | None:
        """The present instance; where there is none, that is told."""
        if (iid := self.session.state.cursor) is None:
            self.session.tell(f"no instance for a {what}: select some")
            self.refresh_views()
        return iid

    def action_note(self) -> None:
        if (iid := self._cursor("note")) is None:
            return
        present = self.session.notes.remarks.get(iid, Remark()).note
        self._ask(partial(self._note, iid), present, f"a note on instance {iid}")

    def _note(self, iid: int, text: str) -> None:
        self.session.book.note(iid, text)

    def action_tag(self) -> None:
        if (iid := self._cursor("tag")) is None:
            return
        hint = f"a tag for instance {iid}; with a * behind it, for the whole selection"
        tags = sorted({t for r in self.session.notes.remarks.values() for t in r.tags})
        self._ask(partial(self._tag, iid), "", hint, tags)

    def _tag(self, iid: int, text: str) -> None:
        everyone = text.rstrip().endswith("*")
        iids = self._everyone() if everyone else [iid]
        tagged = self.session.book.toggle_tag(iids, text.rstrip().rstrip("*"))
        some = f"{len(iids)} instances" if everyone else f"instance {iid}"
        self._tell_kept(f"{'tagged' if tagged else 'tag taken off'}: {some}")

    def _everyone(self) -> list[int]:
        """The selected iids. Raises RequestError for none, or more than a notebook should list."""
        found = np.flatnonzero(self.session.state.selected)
        if not found.size:
            raise RequestError("nothing is selected: there is no instance to tag")
        if found.size > _MOST_TAGGED:
            told = f"{found.size} instances are too many to tag (at most {_MOST_TAGGED})"
            raise RequestError(f"{told}: @ saves the selection by name")
        return [int(iid) for iid in found]

    def action_adjust(self) -> None:
        """Open the panel."""
        if self.session.state.view != "adjust":
            self._open_panel()
        self.refresh_views()

    def _open_panel(self) -> None:
        if self.session.state.cursor is None:
            self.session.tell("no instance to adjust: select some")
            return
        if self.session.state.adjust is None or self.session.state.adjust.missing:
            try:
                found, reason = adjusting.sliders(self.session.store)
                adjusting.begin(self.session, found, reason)
            except ModuleNotFoundError as error:
                adjusting.lack(self.session, str(error.name))
        display.show_view(self.session, "adjust", "tab")

    def action_save_run(self) -> None:
        adjust = self.session.state.adjust
        if adjust is None or not adjust.sliders:
            self.session.tell("nothing to save: no slider is there")
            self.refresh_views()
            return
        if self.saving_refusal:
            self.tell_refusal(self.saving_refusal)
            return
        self._ask(self._save_run, "", "a name for the run with these adjustments")

    def _save_run(self, name: str) -> None:
        adjust, name = self.session.state.adjust, name.strip()
        if not name:
            raise RequestError("a run needs a name: type one")
        if adjust is not None:
            root, chains = self.session.store.path, adjusting.chains(adjust)
            self.begin_saving(name, partial(save_run, root, name, adjust.run, chains))

    def action_selections(self) -> None:
        self._refresh_notes()
        self.push_screen(SelectionsScreen(self.session), self._took)

    def _took(self, text: str | None) -> None:
        if text is not None:
            try:
                shared_selection.take(self.session, text)
            except S2RError as error:
                self.session.tell(str(error), is_error=True)
        self.refresh_views()

    def on_query_input_offered(self, message: QueryInput.Offered) -> None:
        offers = [f"{word} ({what})" for word, what in message.options[:_OFFERS]]
        more = len(message.options) - _OFFERS
        text = "  ".join(offers) + (f"  and {more} more" if more > 0 else "")
        self.session.tell(text or "nothing known continues this")
        self.show_message()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        if self._accept is None:
            return
        self.session.tell("")
        try:
            self._accept(event.value)
        except ExpressionError as error:
            self.session.tell(str(error), is_error=True)
            event.input.cursor_position = min(error.column - 1, len(event.value))
            self.show_message()
            return
        except (S2RError, OSError) as error:
            self.session.tell(str(error), is_error=True)
            self.show_message()
            return
        self._end_prompt()
