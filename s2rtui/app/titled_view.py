"""A view with its title line, as a plot widget draws it."""

from __future__ import annotations

from dataclasses import dataclass

from rich.cells import cell_len, set_cell_size

from s2rtui.app.key_bindings import BY_NAME as ACTIONS
from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.canvas.fit_text import fit_text, wrap_text
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import View

MOST_TITLE_ROWS = 2
"""Most rows of a title."""
_LEAST_ROWS = 8
"""Rows of a view below which its title has one row."""


def truncated(text: str, width: int, options: RenderOptions) -> str:
    """The start of a text in at most `width` cells; an ellipsis marks a cut."""
    return fit_text(text, width, "~" if options.ascii else "…")


@dataclass(frozen=True, slots=True)
class TitledView:
    """A view of a scene under a title with its key, its name and its subtitle."""

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
        waits = self.view.loading(self.scene), self.view.waiting(self.scene)
        return (*depends, self._subtitle, *waits, *title)

    @property
    def _subtitle(self) -> str:
        """The view's subtitle; before it, unless it says so, how many trained ones are counted."""
        text, note = self.view.subtitle(self.scene), self.scene.trained_note
        if not note or not self.view.counts_instances or self.scene.state.count_text in text:
            return text
        return f"{note}; {text}"

    def title(self, size: tuple[int, int], options: RenderOptions) -> list[str]:
        """The lines of the title in a view of `size` (columns, rows): label and subtitle.

        The subtitle continues on a second line where it does not fit beside the label. What is
        being loaded takes the end of the last line and adds none.
        """
        *first, last = self._title_lines(size, options)
        loading = "" if self._unavailable else self.view.loading(self.scene)
        if not loading:
            return [*first, last]
        note = truncated(f"(loading {loading})", size[0] // 2, options)
        return [*first, f"{truncated(last, size[0] - cell_len(note) - 1, options)} {note}"]

    def _title_lines(self, size: tuple[int, int], options: RenderOptions) -> list[str]:
        width, height = size
        label = f"{self.view.key} {self.view.name}"
        if self.scene.state.fills_screen:
            label += f" ({ACTIONS['fill_screen'].key}: all views)"
        if not options.supports_shading:  # a pointer marks the active view
            label = f"{options.glyphs.pointer if self._is_active else ' '} {label}"
        subtitle = "" if self._unavailable else self._subtitle
        most = MOST_TITLE_ROWS if height >= _LEAST_ROWS else 1
        start = cell_len(label) + 2
        if cell_len(subtitle) <= width - start or most == 1 or width < 2 * _LEAST_ROWS:
            return [f"{label}  {truncated(subtitle, max(1, width - start), options)}".rstrip()]
        first, rest = _divided(subtitle, width - start)
        return [f"{label}  {first}".rstrip(), truncated(rest, width, options)]

    @property
    def _is_active(self) -> bool:
        return self.scene.state.view == self.view.name

    @property
    def _unavailable(self) -> str:
        return self.view.unavailable(self.scene.store)

    def draw(self, size: tuple[int, int], options: RenderOptions) -> Canvas:
        """The title over the view's drawing, `size` (columns, rows) together."""
        (width, height), theme, view = size, options.theme, self.view
        canvas = Canvas(width, height, options)
        lines, is_active = self.title(size, options), self._is_active
        if is_active:
            canvas.fill(0, 0, width, len(lines), theme.highlight)
        for row, line in enumerate(lines):
            canvas.text(0, row, line, fg=theme.muted)
        name = lines[0].partition(f"{view.key} {view.name}")
        label = "".join(name[:2])
        canvas.text(0, 0, label, fg=theme.text if is_active else theme.muted, bold=is_active)
        if reason := self._unavailable:
            lines = wrap_text(reason, max(8, width))
            for row, line in enumerate(lines[: max(1, height - 1)], start=min(1, height - 1)):
                canvas.text(0, row, line, fg=theme.muted)
            return canvas
        if height > len(lines):
            drawn = view.draw(self.scene, (width, height - len(lines)), options)
            canvas.paste(drawn, 0, len(lines))
        return canvas


def _divided(text: str, width: int) -> tuple[str, str]:
    """The words that fit into `width` columns, and the rest."""
    end = set_cell_size(text, max(1, width) + 1).rfind(" ")
    return (text[:end], text[end + 1 :]) if end > 0 else ("", text)
