"""The findings in cells: an entry each, the chosen one highlighted."""

from __future__ import annotations

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Panel, RenderOptions, Size
from s2rtui.charts.findings.model import FindingsInput, Line, report_lines
from s2rtui.charts.shared.line_panel import line_panels

_GUTTER = 2


def _window(data: FindingsInput, size: Size) -> tuple[list[Line], int]:
    """The lines, and the first visible one; the chosen finding is visible."""
    width, height = max(1, size[0] - _GUTTER), max(1, size[1])
    lines = report_lines(data, width, height)
    chosen = data.chosen_index
    places = [at for at, line in enumerate(lines) if line.index == chosen and chosen is not None]
    last = places[-1] if places else 0
    first = max(0, min(last - height + 1, places[0] if places else 0))
    return lines, max(first, 0) if len(lines) > height else 0


def draw_findings(
    data: FindingsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS, active: bool = True
) -> Canvas:
    """The view in `size` (columns, rows); `active`: whether the chosen finding is highlighted."""
    canvas = Canvas(*size, options)
    theme, glyphs = options.theme, options.glyphs
    lines, first = _window(data, (canvas.width, canvas.height))
    if not lines:
        canvas.text(0, 0, "nothing is known about this run", theme.muted)
    findings = data.report.findings
    is_first: set[int] = set()
    for y, line in enumerate(lines[first : first + canvas.height]):
        here = line.index is not None and line.index == data.chosen_index
        if here and active:
            canvas.fill(0, y, canvas.width, 1, theme.highlight)
            if line.index not in is_first:
                canvas.put(0, y, glyphs.pointer, theme.truth, bold=True)
                is_first.add(int(line.index or 0))
        evident = line.index is not None and findings[line.index].evident
        ink = theme.text if evident and not line.is_evidence else theme.muted
        x = canvas.text(_GUTTER, y, options.printable(line.label), ink, bold=evident)
        canvas.text(x, y, options.printable(line.text), ink)
    return canvas


def findings_panels(
    data: FindingsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """One panel; y is the index of a finding, -1 for a note."""
    lines, first = _window(data, size)
    return line_panels("findings", [line.index for line in lines], first, size)
