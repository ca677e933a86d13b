"""The texts of the status line and of the message line."""

from __future__ import annotations

from rich.cells import cell_len
from textual.content import Content
from textual.widgets import Static

from s2rstore.reader import Store
from s2rstore.security.printable_text import printable
from s2rtui.app.titled_view import truncated
from s2rtui.canvas import RenderOptions
from s2rtui.charts.scene import LoadedData
from s2rtui.session.state import SIGNS, State

StatusLine = tuple[str, str, str]

_PRIORITIES = {
    "all trajectories": 40,
    "newest": 40,
    "store": 40,
    "newer": 20,
    "coverage": 20,
    "trajectories": 20,
    "run": 20,
}
"""Parts of the status line in the order in which they are left out, with the columns that the
expression must have for them to stay; the count always stays."""


def status_line(store: Store, state: State, width: int, options: RenderOptions) -> StatusLine:
    """Text before the expression (store, trajectories, run, count), the expression, generation.

    If the width is too small, the least important parts are left out, then the expression is cut.
    """
    before, text, after = _fitting_parts(store, state, width, options)
    return "".join(before.values()), text, "".join(after.values())


def part_columns(store: Store, state: State, width: int, options: RenderOptions) -> dict[str, int]:
    """The columns where the parts up to the expression begin, by the keys of `_parts`.

    The expression's key is `expression`.
    """
    before, _, _ = _fitting_parts(store, state, width, options)
    columns, column = {}, 0
    for part, text in (*before.items(), ("expression", "")):
        columns[part] = column
        column += cell_len(text)
    return columns


def _fitting_parts(
    store: Store, state: State, width: int, options: RenderOptions
) -> tuple[dict[str, str], str, dict[str, str]]:
    """The parts before the expression, the expression, and the parts after it, in `width`."""
    separator = " | " if options.ascii else " │ "
    text = state.expression
    if state.operator != "replace":
        text += f" {SIGNS[state.operator]} _"
    parts = _parts(store, state)
    before = {part: value + separator for part, value in parts[0].items()}
    after = {part: separator + value for part, value in parts[1].items()}
    room = 0
    for part, readable in (("", 0), *_PRIORITIES.items()):
        if part and room >= min(cell_len(text), readable):
            break
        before.pop(part, None)
        after.pop(part, None)
        room = width - 2 - sum(map(cell_len, (*before.values(), *after.values())))
    return before, truncated(text, max(8, room), options), after


def _parts(store: Store, state: State) -> tuple[dict[str, str], dict[str, str]]:
    """The parts before and after the expression, by the keys of `_PRIORITIES`."""
    view = state.trajectories
    before = {
        "store": printable(store.path.name),
        "all trajectories" if view is None else "trajectories": (
            f"traj {', '.join(view or ('all',))}"
        ),
        "run": f"run {state.run}{_pending_text(state)}" if state.run else "no runs",
        "coverage": store.coverage(state.run).summary,
        "count": state.count_text,
    }
    if not before["coverage"]:
        del before["coverage"]
    if state.newest == state.generation:
        return before, {"newest": f"generation {state.generation}"}
    return before, {"newer": f"generation {state.generation} ({state.newest} available, press g)"}


def _pending_text(state: State) -> str:
    pending = state.pending
    if pending is None:
        return ""
    if pending.run != state.run:
        return f" (loading {pending.run})"
    if pending.generation != state.generation:
        return f" (loading generation {pending.generation})"
    return " (selecting)"


def message_text(state: State, resources: LoadedData, hovered: str = "", cursor: str = "") -> str:
    """The message line: an error, the instance under the mouse, a message, or a newer generation.

    `hovered` and `cursor` describe the instances under the mouse and at the cursor; the cursor's is
    shown where there is no message. Background progress follows.
    """
    if hovered and not state.is_error:
        return hovered
    text = state.message or resources.computation
    if not state.is_error:
        text = resources.with_progress(text)
    if not text and state.newest != state.generation:
        return f"generation {state.newest} is available: press g to open it"
    return text or cursor


Piece = str | tuple[str, str]
"""Text, or text with a style such as `bold`."""


class TextBar(Static):
    """Updates only when its content changes; no text in it is markup."""

    def __init__(self, name: str) -> None:
        super().__init__("", id=name, markup=False)
        self._pieces: tuple[Piece, ...] = ()

    def show(self, *pieces: Piece, classes: str = "") -> None:
        """Show pieces of text, with CSS classes for the whole line."""
        if pieces != self._pieces:
            self._pieces = pieces
            self.update(Content.assemble(*(_printable_piece(piece) for piece in pieces)))
        self.set_classes(classes)


def _printable_piece(piece: Piece) -> Piece:
    return printable(piece) if isinstance(piece, str) else (printable(piece[0]), piece[1])
