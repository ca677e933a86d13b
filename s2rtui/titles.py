"""The status line, and the title above every view."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from s2rstore.reader import Store
from s2rtui.canvas import Canvas, Look
from s2rtui.session.state import SIGNS, State
from s2rtui.views import Scene, View

StatusLine = tuple[str, str, str]
Draw = Callable[[tuple[int, int], Look], Canvas]


def status_line(store: Store, state: State, width: int, look: Look) -> StatusLine:
    """Store, trajectory, run, count; the expression; generation. Cut to the width."""
    trajectory = "all" if state.trajectories is None else ", ".join(state.trajectories)
    separator = " | " if look.ascii else " │ "
    run = f"run {state.run}" + (f" (loading {state.awaited.run})" if state.awaited else "")
    parts = [store.path.name, f"traj {trajectory}", run, state.count]
    head = separator.join(parts) + separator
    newer = f" ({state.newest} is there: g)" if state.newest != state.generation else ""
    tail = f"{separator}gen {state.generation}{newer}"
    room = max(8, width - 2 - len(head) - len(tail))
    text = state.expression
    if state.operator != "replace":
        text += f" {SIGNS[state.operator]} _"
    if len(text) > room:
        text = text[: room - 1] + ("~" if look.ascii else "…")
    return head, text, tail


def shown(view: View, scene: Scene) -> tuple[Draw, tuple[object, ...] | None]:
    """A view's drawing under its title, and all that it depends on (None: draw it always)."""
    depends = view.depends(scene)
    if depends is not None:
        depends = (*depends, view.told(scene), scene.state.view == view.name)
    return titled(view, scene, partial(view.draw, scene)), depends


def titled(view: View, scene: Scene, draw: Draw) -> Draw:
    """A drawing with a line above it: the view's key, name and what it shows."""
    active = scene.state.view == view.name
    label, told = f"{view.key} {view.name}", view.told(scene)

    def drawn(size: tuple[int, int], look: Look) -> Canvas:
        width, height = size
        canvas = Canvas(width, height, theme=look.theme)
        theme = look.theme
        if active:
            canvas.fill(0, 0, width, 1, theme.highlight)
        canvas.text(0, 0, label, fg=theme.text if active else theme.muted, bold=active)
        start = len(label) + 2
        if start < width:
            canvas.text(start, 0, told[: width - start], fg=theme.muted)
        if height > 1:
            canvas.paste(draw((width, height - 1), look), 0, 1)
        return canvas

    return drawn
