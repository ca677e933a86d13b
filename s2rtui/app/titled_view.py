"""A view with its title line, as a plot widget draws it."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from s2rtui.app.key_bindings import BY_NAME as ACTIONS
from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import View

TITLE_ROWS = 1


def truncated(text: str, width: int, options: RenderOptions) -> str:
    """At most `width` characters; an ellipsis marks a cut."""
    return text if len(text) <= width else text[: width - 1] + ("~" if options.ascii else "…")


@dataclass(frozen=True, slots=True)
class TitledView:
    """A view of a scene under a line with its key, its name and its subtitle."""

    view: View
    scene: Scene

    @property
    def cache_key(self) -> tuple[object, ...] | None:
        """Key of everything the drawing depends on; None draws it always."""
        state = self.scene.state
        title = state.view == self.view.name, state.fills_screen
        if reason := self._unavailable:
            return reason, *title
        depends = self.view.cache_key(self.scene)
        if depends is None:
            return None
        return (*depends, self._subtitle, *title)

    @property
    def _subtitle(self) -> str:
        """The view's subtitle; before it, unless it says so, how many trained ones are counted."""
        text, note = self.view.subtitle(self.scene), self.scene.trained_note
        if not note or not self.view.counts_instances or self.scene.state.count in text:
            return text
        return f"{note}; {text}"

    @property
    def _unavailable(self) -> str:
        return self.view.unavailable(self.scene.store)

    def draw(self, size: tuple[int, int], options: RenderOptions) -> Canvas:
        """The title line over the view's drawing, `size` (columns, rows) together."""
        (width, height), theme, view = size, options.theme, self.view
        is_active = self.scene.state.view == view.name
        label = f"{view.key} {view.name}"
        if self.scene.state.fills_screen:
            label += f" ({ACTIONS['fill_screen'].key}: all views)"
        canvas = Canvas(width, height, options)
        if is_active and not options.supports_shading:
            label = f"{options.glyphs.pointer} {label}"
        if is_active:
            canvas.fill(0, 0, width, 1, theme.highlight)
        canvas.text(0, 0, label, fg=theme.text if is_active else theme.muted, bold=is_active)
        start = len(label) + 2
        if reason := self._unavailable:
            lines = textwrap.wrap(reason, max(8, width))
            for row, line in enumerate(lines[: max(1, height - 1)], start=min(1, height - 1)):
                canvas.text(0, row, line, fg=theme.muted)
            return canvas
        if start < width:
            subtitle = truncated(self._subtitle, width - start, options)
            canvas.text(start, 0, subtitle, fg=theme.muted)
        if height > 1:
            canvas.paste(view.draw(self.scene, (width, height - 1), options), 0, 1)
        return canvas
