"""The status line, and the title above every view."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from s2rstore.reader import Store
from s2rstore.security.printable_text import printable
from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.charts.scene import Resources, Scene
from s2rtui.charts.view import View
from s2rtui.session.state import SIGNS, State

StatusLine = tuple[str, str, str]
Draw = Callable[[tuple[int, int], RenderOptions], Canvas]


_LEAST = {"everywhere": 40, "newest": 40, "store": 40, "newer": 20, "trajectories": 20, "run": 20}
"""Parts of the status line, the first to be left out first, and the columns that an expression
gets before them; the count always stands."""


def status_line(store: Store, state: State, width: int, look: RenderOptions) -> StatusLine:
    """Store, trajectory, run, count; the expression; generation.

    Where the width lacks, what says least is left out first, and the expression is cut last.
    """
    separator = " | " if look.ascii else " │ "
    text = state.expression
    if state.operator != "replace":
        text += f" {SIGNS[state.operator]} _"
    before, after = _parts(store, state)
    head, tail, room = "", "", 0
    for least, readable in (("", 0), *_LEAST.items()):
        if least and room >= min(len(text), readable):
            break
        before.pop(least, None)
        after.pop(least, None)
        head = "".join(part + separator for part in before.values())
        tail = "".join(separator + part for part in after.values())
        room = width - 2 - len(head) - len(tail)
    return head, cut(text, max(8, room), look), tail


def _parts(store: Store, state: State) -> tuple[dict[str, str], dict[str, str]]:
    """What stands before the expression, and after it, by the words of `_LEAST`."""
    view = state.trajectories
    before = {
        "store": printable(store.path.name),
        "everywhere" if view is None else "trajectories": f"traj {', '.join(view or ('all',))}",
        "run": f"run {state.run}{_coming(state)}",
        "count": state.count,
    }
    if state.newest == state.generation:
        return before, {"newest": f"gen {state.generation}"}
    return before, {"newer": f"gen {state.generation} ({state.newest} is there: g)"}


def _coming(state: State) -> str:
    """What is on its way beside the run that is shown."""
    awaited = state.awaited
    if awaited is None:
        return ""
    if awaited.run != state.run:
        return f" (loading {awaited.run})"
    if awaited.generation != state.generation:
        return f" (loading generation {awaited.generation})"
    return " (selecting)"


def message(state: State, resources: Resources) -> str:
    """What is told at the foot: the last step's words, else what goes on, else what is new."""
    text = state.message or resources.saving
    if not state.is_error:
        text = resources.with_progress(text)
    if not text and state.newest != state.generation:
        return f"generation {state.newest} is there: g moves on to it"
    return text


def cut(text: str, width: int, look: RenderOptions) -> str:
    """At most `width` characters; what was cut shows an ellipsis."""
    return text if len(text) <= width else text[: width - 1] + ("~" if look.ascii else "…")


def shown(view: View, scene: Scene) -> tuple[Draw, tuple[object, ...] | None]:
    """A view's drawing under its title, and all that it depends on (None: draw it always)."""
    depends = view.cache_key(scene)
    if depends is not None:
        depends = (*depends, view.subtitle(scene), scene.state.view == view.name)
    return titled(view, scene, partial(view.draw, scene)), depends


def titled(view: View, scene: Scene, draw: Draw) -> Draw:
    """A drawing with a line above it: the view's key, name and what it shows."""
    active = scene.state.view == view.name
    label, told = f"{view.key} {view.name}", view.subtitle(scene)

    def drawn(size: tuple[int, int], look: RenderOptions) -> Canvas:
        width, height = size
        canvas = Canvas(width, height, theme=look.theme)
        theme = look.theme
        if active:
            canvas.fill(0, 0, width, 1, theme.highlight)
        canvas.text(0, 0, label, fg=theme.text if active else theme.muted, bold=active)
        start = len(label) + 2
        if start < width:
            canvas.text(start, 0, cut(told, width - start, look), fg=theme.muted)
        if height > 1:
            canvas.paste(draw((width, height - 1), look), 0, 1)
        return canvas

    return drawn
