"""The difference map: where one run errs less than another on the same selection."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np
from rich.cells import cell_len

from s2rstore.records import Bounds
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, PlotArea, RenderOptions, Rgb, Size, legible
from s2rtui.canvas.fit_text import fit_text
from s2rtui.charts.compare.change import ALL, HEADINGS, NOT_EVIDENT, UNKNOWN, table_rows
from s2rtui.charts.compare.model import (
    CompareInput,
    CompareModel,
    cell_means,
    change_signs,
    compare_model,
    difference_colours,
)
from s2rtui.charts.compare.pixels import compare_key, paint_compare
from s2rtui.charts.shared.base_map_model import default_view
from s2rtui.charts.shared.base_map_terminal import (
    MapLayout,
    SelectedMarks,
    draw_point_map,
    draw_pose,
    layout_of_area,
    map_legend,
    map_panel,
    put_glyphs,
    several_legend,
)
from s2rtui.charts.shared.point_bins import marked_cells
from s2rtui.drawing.legend import NO_BREAK, LegendPart, colour_bar, ramp_for_values, text_part
from s2rtui.drawing.scale import short_number
from s2rtui.drawing.trained_marks import (
    TrainedForms,
    glyph_forms,
    mark_trained,
    trained_legend,
)

MIN_TABLE = 4
"""Fewest rows of a table of rooms: headings, a room, all instances, and which rooms are shown."""
MIN_TABLE_WIDTH, WIDE_TABLE = 48, 64
"""Fewest columns of a table of rooms without intervals, and with them."""
_INTERVAL = HEADINGS.index("95 % interval")

SEVERAL, ONE = "▼●▲", "▾•▴"
"""Glyphs of cells with several instances, and of those with one."""
OUTLINED = "▽○△", "▿◦▵"
"""The same for cells with trained instances."""
RINGED, LETTERS = "⊖⊜⊕", "bea"
"""The same without colours, and in ASCII: run B is better, both are equal, A is better."""


def difference_glyphs(options: RenderOptions) -> str:
    """Three glyphs: the change is negative (the second run is better), equal, positive."""
    return "-=+" if ramp_for_values(options) is not None else SEVERAL


def compare_layout(
    data: CompareInput,
    size: Size,
    viewport: Bounds | None = None,
    options: RenderOptions = DEFAULT_OPTIONS,
    model: CompareModel | None = None,
) -> MapLayout:
    """Lay out the map in `size`; `viewport` is a world rectangle (default: the bounds)."""
    model = model or compare_model(data)
    area = viewport or default_view(data.bounds, data.truth, data.valid)

    def legend(frame: MapFrame, width: int) -> list[LegendPart]:
        return _legend(data, model, frame, width, options)

    return layout_of_area(area, data.y_down, size, legend)


def compare_panels(
    data: CompareInput,
    size: Size,
    options: RenderOptions = DEFAULT_OPTIONS,
    viewport: Bounds | None = None,
) -> tuple[PlotArea, ...]:
    """One panel "map", a plane of metres."""
    return (map_panel(compare_layout(data, size, viewport, options)),)


def draw_compare(
    data: CompareInput,
    size: Size,
    options: RenderOptions = DEFAULT_OPTIONS,
    viewport: Bounds | None = None,
) -> Canvas:
    """Draw the mean difference of the selected per cell in `size` (columns, rows)."""
    model = compare_model(data)
    layout = compare_layout(data, size, viewport, options, model)

    def draw_selected(chart: Canvas) -> None:
        _cells(chart, data, model, layout.frame)
        _mark_trained(chart, data, model, layout.frame)
        if model.cursor is not None:
            draw_pose(chart, data.truth, None, model.cursor, layout.frame, "cursor")

    marks = SelectedMarks(
        draw_selected, lambda picture: paint_compare(picture, data, model), compare_key(data)
    )
    return draw_point_map(data, model.selection, layout, size, options, marks)


@dataclass(frozen=True, slots=True)
class ComparisonText:
    """Sentences over a table of rooms, of which `shown` rooms from `first` on are visible."""

    lines: list[str]
    first: int
    shown: int

    @property
    def has_table(self) -> bool:
        return self.shown > 0


def layout_text(data: CompareInput, size: Size, options: RenderOptions) -> ComparisonText:
    """Lay out the comparison in `size` (columns, rows)."""
    width, height = size
    lines = textwrap.wrap(options.printable(data.sentences), max(10, width))[: max(1, height)]
    rooms, free = len(data.changes.rooms), height - len(lines)
    if free < MIN_TABLE or width < MIN_TABLE_WIDTH or rooms < 2:
        return ComparisonText(lines, 0, 0)
    shown = rooms if rooms + 2 <= free else free - 3
    return ComparisonText(lines, min(max(0, data.first_room), rooms - shown), shown)


def comparison_text(data: CompareInput, size: Size, options: RenderOptions) -> Canvas:
    """The comparison in sentences over the table of rooms, as high as they need within `size`.

    Where some rooms have no place in the table, its last row says which are shown.
    """
    layout, changes = layout_text(data, size, options), data.changes
    table: list[tuple[str, ...]] = []
    if layout.has_table:
        last = layout.first + layout.shown
        rooms = changes.by_size
        table = [HEADINGS, *table_rows(rooms[layout.first : last], changes.whole)]
        if size[0] < WIDE_TABLE:
            table = [(*row[:_INTERVAL], *row[_INTERVAL + 1 :]) for row in table]
        if layout.shown < len(rooms):
            more = "down: more" if last < len(rooms) else "up: the first ones"
            table.append((f"rooms {layout.first + 1} to {last} of {len(rooms)} ({more})",))
    canvas = Canvas(size[0], max(1, len(layout.lines) + len(table)), options)
    for row, line in enumerate(layout.lines):
        canvas.text(0, row, line, options.theme.text)
    _table(canvas, table, len(layout.lines))
    return canvas


def _table(canvas: Canvas, table: list[tuple[str, ...]], top: int) -> None:
    """Draw rows of text in columns, the room at the left, numbers at their column's right end."""
    if not table:
        return
    theme, ends = canvas.theme, []
    whole = [row for row in table if len(row) == len(table[0])]
    widths = [max(map(cell_len, column)) for column in zip(*whole, strict=True)]
    rest = sum(widths[1:]) + 2 * len(widths[1:])
    widths[0] = min(max(widths[0], 12), canvas.width - rest)
    at = 0
    for width in widths:
        at += width
        ends.append(at)
        at += 2
    for row, cells in enumerate(table, start=top):
        name = canvas.options.printable(cells[0])
        if len(cells) > 1:
            name = fit_text(name, widths[0], canvas.glyphs.ellipsis)
        heading = row == top
        ink = theme.muted if heading or len(cells) == 1 else theme.text
        canvas.text(0, row, name, ink, bold=cells[0] == ALL)
        for text, end in zip(cells[1:], ends[1:], strict=False):
            last = text == cells[-1] and not heading
            evident = last and text not in (NOT_EVIDENT, UNKNOWN)
            colour = theme.truth if evident else theme.muted if last else ink
            canvas.text(end, row, text, colour, align="right")


def _cells(canvas: Canvas, data: CompareInput, model: CompareModel, frame: MapFrame) -> None:
    """A glyph per cell in the colour of its mean, larger or bold for several instances."""
    columns, rows, means, counts = cell_means(
        data.truth, data.first, data.second, model.selection, frame
    )
    put_glyphs(canvas, columns, rows, " ", canvas.theme.text)
    sign = change_signs(means, data.equal) + 1
    glyphs = difference_glyphs(canvas.options)
    one = ONE if glyphs == SEVERAL else glyphs
    many = counts > 1
    canvas.char[rows, columns] = np.where(
        many, np.array(list(glyphs))[sign], np.array(list(one))[sign]
    )
    canvas.fg[rows, columns] = legible(difference_colours(means, model.scale), canvas.theme)
    canvas.bold[rows, columns] = many


def _mark_trained(canvas: Canvas, data: CompareInput, model: CompareModel, frame: MapFrame) -> None:
    """Mark the glyphs where a model of either run was trained on a selected instance."""
    if data.trained is not None:
        cells = marked_cells(data.truth, data.trained, model.selection, frame)
        mark_trained(canvas, cells, trained_forms(canvas.options))


def trained_forms(options: RenderOptions) -> TrainedForms:
    """The forms of `difference_glyphs` that mark trained instances."""
    glyphs = difference_glyphs(options)
    if glyphs == SEVERAL:
        return glyph_forms(SEVERAL + ONE, "".join(OUTLINED), OUTLINED[0])
    if options.ascii:
        return glyph_forms(glyphs, LETTERS, f"{LETTERS} (for {glyphs})")
    return glyph_forms(glyphs, RINGED)


def _legend(
    data: CompareInput, model: CompareModel, frame: MapFrame, width: int, options: RenderOptions
) -> list[LegendPart]:
    first, second = (_name(name, options) for name in data.names)
    bar = colour_bar(
        f"{data.side} error, {second} - {first}",
        data.unit,
        (-model.scale, model.scale),
        options,
        12 if width >= 50 else 8,
        colours=lambda shares: difference_colours(2 * shares - 1, 1.0),
        ramp=difference_glyphs(options) if ramp_for_values(options) is not None else None,
        room=width,
    )
    counts = _counts(data, model, (first, second), options)
    trained = [] if data.trained is None else [trained_legend(options, trained_forms(options))]
    several = [several_legend(options, SEVERAL)] if model.highlighted > 1 else []
    rest = map_legend(frame, width, model.others, data.clip is not None, options)
    return [counts, *trained, bar, *several, *rest]


def _counts(
    data: CompareInput, model: CompareModel, names: tuple[str, str], options: RenderOptions
) -> LegendPart:
    """How often each of the runs `names` is better."""
    theme, summary = options.theme, model.summary
    ends = legible(difference_colours([-1.0, 0.0, 1.0], 1.0), theme)
    blue, grey, orange = ((int(r), int(g), int(b)) for r, g, b in ends)
    lower, same, upper = tuple(difference_glyphs(options))
    pieces: list[tuple[str, Rgb]] = []
    for glyph, colour, number, explanation in (
        (lower, blue, summary.improved, f" better in {names[1]}"),
        (upper, orange, summary.worse, f" better in {names[0]}"),
        (
            same,
            grey,
            summary.equal,
            f" within {short_number(data.equal)}{NO_BREAK}{data.unit}",
        ),
    ):
        pieces += [(f"{glyph} ", colour), (f"{number}{explanation}  ", theme.text)]
    return text_part(pieces)


def _name(name: str, options: RenderOptions) -> str:
    """A run's name, cut to fit into a legend."""
    return fit_text(options.printable(name), 16, options.glyphs.ellipsis)
