"""Where the parts of a drawing are in character cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from rich.cells import cell_len

from s2rtui.canvas import RenderOptions, Size
from s2rtui.canvas.colour import NO_DEPTH
from s2rtui.canvas.fit_text import wrap_text
from s2rtui.canvas.render_options import UNICODE
from s2rtui.drawing.drawing import ColourBar, Drawing, Note
from s2rtui.drawing.heat_colours import IMAGE_RAMPS, ramp_colours, ramp_glyphs
from s2rtui.drawing.image import ImageValues
from s2rtui.drawing.image_cells import Box, arrange_images, visible_rows
from s2rtui.drawing.legend import (
    LegendPart,
    colour_bar,
    cut_rows,
    fit_rows,
    point_colours,
    text_part,
)
from s2rtui.drawing.plane_cells import plane_legend
from s2rtui.drawing.plane_marks import PlaneMark
from s2rtui.drawing.plot import Phrase, Plot, Points
from s2rtui.drawing.plot_cells import dial_rows, row_of
from s2rtui.drawing.points_cells import points_legend
from s2rtui.drawing.table_layout import GAP, wanted_lines

_FEWEST_ROWS = 5
"""Rows of a single plot above a table, without its axis, from which on it is drawn."""
_KEPT_ROWS = 3
"""Lines that a table keeps below plots on a plane, which otherwise are left out."""
_FEWEST_STACKED = 3
"""Rows of each of several plots; those of smaller weight are left out where it has fewer."""
_FEWEST_COLUMNS, _FEWEST_WITH_AXES = 16, 8
"""Columns of a plot beside which labels of y have room; rows of planes and dials with axes."""
_FEWEST_WITH_NOTES = 6
"""Rows of a drawing from which on it has notes beside plots, or before rows of a table."""
_KEPT_AREA = 0.6
"""Images keep at least this share of their area where notes stand below them."""
_FEWEST_OF_IMAGE, _WITH_TITLE = 4, 4
"""Rows of each of several images; rows of a drawing from which on images have titles."""
_GAP = 1
"""Columns between plots beside each other."""
_TEXT_COLUMNS, _LARGER = 46, 1.2
"""Columns of table and notes beside images; factor by which the area of these must grow so."""
Rows = tuple[tuple[LegendPart, ...], ...]


@dataclass(frozen=True, slots=True, eq=False)
class PlotPlace:
    """Where a plot is: first column and row of its marks, their number, and its title and axis.

    start: the first column, labels of y included. head: row of the title. axis: row of the axis,
    below a dial of the texts of the title that follow its name.
    """

    plot: Plot
    start: int
    left: int
    width: int
    top: int
    rows: int
    head: int | None
    axis: int | None


@dataclass(frozen=True, slots=True, eq=False)
class DrawingLayout:
    """Where the parts of a drawing are.

    table: first row of the table and the number of rows that it has. notes: the last rows. bars:
    the rows of colour bars between images and the table.
    """

    plots: tuple[PlotPlace, ...]
    table: tuple[int, int]
    notes: Rows
    bars: Rows = ()


def drawing_layout(drawing: Drawing, size: Size, options: RenderOptions) -> DrawingLayout:
    """Lay out a drawing in `size` (columns, rows).

    Plots have the rows that the table and the notes leave, but at least `_FEWEST_ROWS`, and planes
    `_FEWEST_WITH_AXES`, where the canvas is twice as high; then the last rows of the table are left
    out, and its head says so.
    Where there is no room for all plots, a note names those that are left out. Dials become plots
    with a straight axis of x above each other where there is no room for discs.
    """
    width, height = max(1, size[0]), max(1, size[1])
    if any(plot.image is not None for plot in drawing.plots):
        return _around_images(drawing, width, height, options)
    plots, left_out = list(drawing.plots), list[Plot]()
    wanted = 0 if drawing.table is None else wanted_lines(drawing.table)
    while True:
        texts = [*drawing.notes, *no_room_notes(left_out)]
        of_notes = width, _most_notes(drawing, height), options
        notes = _note_rows(texts, plots, (width, height), *of_notes)
        if drawing.table is not None and any(plot.is_tight for plot in plots):
            texts = _whole_texts(texts, plots, (width, height), *of_notes)
            notes = _note_rows(texts, plots, (width, height), *of_notes)
        least = _FEWEST_ROWS if drawing.table is not None or notes else 1
        extra = 1 + any(map(has_head, plots))
        if drawing.table is not None and height >= 2 * (_FEWEST_WITH_AXES + extra):
            least = _FEWEST_WITH_AXES if any(plot.is_tight for plot in plots) else least
        area = height - wanted - len(notes)
        kept = min(wanted, _KEPT_ROWS) if any(plot.is_tight for plot in plots) else 0
        if plots and height >= 2 * (least + extra) and height - len(notes) - least - extra >= kept:
            area = max(area, min(height, least + extra))
        is_beside = drawing.beside and len(plots) > 1 and 2 * area <= width
        lightest = min(plots, key=lambda plot: plot.weight) if plots else None
        if lightest is None or is_beside or area >= _needed(plots):
            break
        if lightest.weight == max(plot.weight for plot in plots):
            break
        left_out.append(lightest)
        plots.remove(lightest)
    places: tuple[PlotPlace, ...] = ()
    top = 0
    if plots and area >= (least if drawing.table is not None else 1):
        places = tuple((_beside if is_beside else _stacked)(plots, width, area))
        if any(plot.turns for plot in plots):
            dials = [_around_dial(place, options) for place in places]
            known = [place for place in dials if place is not None]
            straight = [replace(plot, turns=None) for plot in plots]
            is_round = len(known) == len(dials)
            places = tuple(known if is_round else _stacked(straight, width, area))
        top = area
        exact = _note_rows(texts, plots, (places[0].width, places[0].rows), *of_notes)
        notes = exact if len(exact) <= len(notes) else notes
    elif drawing.plots:
        strings = [note for note in drawing.notes if isinstance(note, str)]
        notes = _note_rows(strings, (), (1, 1), width, height // 2, options)
    return DrawingLayout(places, (top, max(0, height - len(notes) - top)), notes)


def _around_dial(place: PlotPlace, options: RenderOptions) -> PlotPlace | None:
    """The place without rows that its disc leaves; None where the disc would be too small."""
    rows = dial_rows(place.plot, place.width, place.rows, options)
    if rows is None:
        return None
    above = (place.rows - rows) // 2
    axis = None if place.axis is None else place.axis - (place.rows - rows - above)
    head = None if place.head is None else place.head + above
    return replace(place, top=place.top + above, rows=rows, head=head, axis=axis)


def no_room_notes(left_out: Sequence[Plot]) -> tuple[str, ...]:
    """A note that names the plots that are left out, if there are any."""
    named = ", ".join(plot.title[0].text if plot.title else plot.name for plot in left_out)
    return (f"no room for {named}",) if named else ()


def note_rows(notes: Sequence[Note], width: int, options: RenderOptions) -> Rows:
    """Notes in rows of at most `width` cells."""
    return _note_rows(notes, (), (1, 1), width, None, options)


def _most_notes(drawing: Drawing, height: int) -> int:
    """Rows of notes; those of a table without plots come before all notes but one row."""
    if drawing.table is None and not drawing.plots:
        return height
    least = int(height >= _FEWEST_WITH_NOTES)
    if drawing.table is not None and any(plot.is_tight for plot in drawing.plots):
        free = height - _FEWEST_ROWS - 2 - min(wanted_lines(drawing.table), _KEPT_ROWS)
        return max(least, min(height // 2, free))
    if drawing.plots or drawing.table is None:
        return least * (height // 2)
    return max(least, height - wanted_lines(drawing.table))


def _whole_texts(
    notes: Sequence[Note], plots: Sequence[Plot], size: Size, width: int, most: int,
    options: RenderOptions,
) -> list[Note]:  # fmt: skip
    """The notes without the longest texts, for which `most` rows are too few beside a table."""
    kept = list(notes)
    for text in sorted((note for note in notes if isinstance(note, str)), key=len, reverse=True):
        if len(_note_rows(kept, plots, size, width, None, options)) > most:
            kept.remove(text)
    return kept


def _note_rows(
    notes: Sequence[Note], plots: Sequence[Plot], size: Size, width: int, most: int | None,
    options: RenderOptions,
) -> Rows:  # fmt: skip
    """Notes, and what the marks of plots in `size` cells show, each in `width` cells.

    An ellipsis ends the last of `most` rows.
    """
    rows: list[list[LegendPart]] = []
    muted = options.theme.muted
    points = [mark for plot in plots for mark in plot.marks if isinstance(mark, Points)]
    marks = _mark_parts(plots, *size, options)
    for place, note in enumerate(notes):
        if isinstance(note, str):
            rows += [[text_part(((options.printable(line), muted),))]
                     for line in wrap_text(note, width)]  # fmt: skip
            continue
        parts = [part for item in note for part in _note_parts(item, width, options)]
        if points and place == 0:
            parts += points_legend(points[0], options)
        parts, marks = [*parts, *marks], []
        rows += fit_rows(parts, width)
    return tuple(map(tuple, cut_rows(rows, width, most, options)))


def _note_parts(
    item: Phrase | ColourBar, width: int, options: RenderOptions, of_image: int = 16
) -> list[LegendPart]:
    """A phrase or a colour bar; of_image: length of one of images."""
    if isinstance(item, Phrase):
        text = options.printable(item.whole(options.glyphs))
        return [text_part(((text, getattr(options.theme, item.ink)),))]
    ramp, colours = ramp_glyphs(item.ramp, options), ramp_colours(item.ramp)
    if item.ramp == "values":
        colours = ramp_colours("values", point_colours(options.theme))
    is_of_image = item.ramp in IMAGE_RAMPS
    length = 10 if ramp else 8 if width < 60 else 16
    if is_of_image:
        length = min(of_image, len(ramp)) if ramp else of_image
    bars = colour_bar(
        options.printable(item.label), options.printable(item.unit), item.scale, options, length,
        colours, ramp=ramp, room=width, clipped=item.clipped and not is_of_image,
    )  # fmt: skip
    if item.ramp == "depth" and options.supports_images:
        return [*bars, text_part((("■ ", NO_DEPTH), ("no depth", options.theme.muted)))]
    return list(bars)


def _mark_parts(plots: Sequence[Plot], width: int, height: int, options: RenderOptions
                ) -> list[LegendPart]:  # fmt: skip
    """What the marks of plots on a plane show, each kind of mark once.

    The plots have `width` x `height` cells.
    """
    parts: dict[type, list[LegendPart]] = {}
    for plot in (plot.fitted(width, 2 * height) for plot in plots):
        pitch = abs(plot.x.high - plot.x.low) / width
        for mark in reversed(plot.marks):
            if isinstance(mark, PlaneMark) and not parts.get(type(mark)):
                parts[type(mark)] = plane_legend(mark, plot, options, width, pitch)
    return [part for each in parts.values() for part in each]


def has_head(plot: Plot) -> bool:
    """Whether a row above a plot shows its title or its legend, where there is room."""
    return bool(plot.title or plot.legend)


def _has_axis(plots: Sequence[Plot], place: int) -> bool:
    is_last = place == len(plots) - 1 or plots[place].x != plots[place + 1].x
    return is_last or plots[place].turns is not None


def _needed(plots: Sequence[Plot]) -> int:
    """Rows of several plots at least."""
    return sum(
        _FEWEST_STACKED + has_head(plot) + _has_axis(plots, place)
        for place, plot in enumerate(plots)
    )


def _stacked(plots: list[Plot], width: int, area: int) -> list[PlotPlace]:
    """Plots of equal height in `area` rows; in low areas titles and axes are left out.

    Those with the same scales have exactly the same number of rows.
    """
    plots = plots[:area]
    heads = sum(map(has_head, plots))
    axes = sum(_has_axis(plots, place) for place in range(len(plots)))
    with_axes = area >= len(plots) * _least_rows(plots) + axes
    with_heads = area >= len(plots) * 2 + axes * with_axes + heads
    free = area - axes * with_axes - heads * with_heads
    left = max(_label_width(plot, max(1, free // len(plots)), width) for plot in plots) * with_axes
    if not with_heads and heads and (names := max(map(title_width, plots)) + 1) <= width // 4:
        left = max(left, names)
    left = left if width - left >= _FEWEST_COLUMNS else 0
    if all((plot.x, plot.y) == (plots[0].x, plots[0].y) for plot in plots):
        free -= free % len(plots)
    places, top = [], 0
    for place, plot in enumerate(plots):
        head = top if with_heads and has_head(plot) else None
        first = top + (head is not None)
        rows = max(1, free // (len(plots) - place))
        free -= rows
        axis = first + rows if with_axes and _has_axis(plots, place) else None
        columns = max(1, width - left)
        shown = plot.fitted(columns, 2 * rows)
        places.append(PlotPlace(shown, 0, left, columns, first, rows, head, axis))
        top = first + rows + (axis is not None)
    return places


def _beside(plots: list[Plot], width: int, area: int) -> list[PlotPlace]:
    """Plots of equal width; in low or narrow areas axes, and in lower ones titles, are left out."""
    room = max(1, (width - _GAP * (len(plots) - 1)) // len(plots))
    head = int(area >= 4 and any(map(has_head, plots)))
    rows = max(1, area - head)
    left = max(_label_width(plot, rows, room) for plot in plots)
    with_axes = rows > _least_rows(plots) and room - left >= _FEWEST_COLUMNS
    rows -= with_axes
    left = left if with_axes else 0
    places = []
    for place, plot in enumerate(plots):
        start = place * (room + _GAP)
        shown = plot.fitted(room - left, 2 * rows)
        places.append(PlotPlace(
            shown, start, start + left, room - left, head, rows, 0 if head else None,
            head + rows if with_axes else None,
        ))  # fmt: skip
    return [place for place in places if place.left < width]


def _least_rows(plots: Sequence[Plot]) -> int:
    """Rows of a plot from which on it has an axis."""
    if any(plot.shape == "plane" or plot.turns for plot in plots):
        return _FEWEST_WITH_AXES
    return 1 if any(plot.shape == "turn" for plot in plots) else 2


def title_width(plot: Plot) -> int:
    """Columns of the first text of a title, with its sign."""
    return cell_len(plot.title[0].whole(UNICODE)) if plot.title else 0


def y_labels(plot: Plot, rows: int) -> dict[int, str]:
    """The labels of y by their rows."""
    found = plot.y.labels(rows, max(3, rows // 3), lambda text: 0.0, 1.0)
    return {row_of(plot.y, float(plot.y.value(tick / rows)), rows): text for _, tick, text in found}


def _label_width(plot: Plot, rows: int, width: int) -> int:
    """Columns of the labels of y and the blank beside them, and of its name without a title."""
    if plot.turns:
        return 0
    shown = plot.fitted(width, 2 * rows)
    widths = [cell_len(text) + 1 for text in y_labels(shown, rows).values() if text]
    if widths and plot.y.names and not has_head(plot):
        widths.append(cell_len(plot.y.names[-1]))
    return max(widths, default=0)


def dividers(layout: DrawingLayout) -> list[int]:
    """The columns between plots that stand beside each other, but not between dials and images."""
    plots = [place for place in layout.plots if not place.plot.turns and place.plot.image is None]
    return [second.start - 1 for first, second in pairwise(plots) if first.top == second.top]


def _around_images(
    drawing: Drawing, width: int, height: int, options: RenderOptions
) -> DrawingLayout:
    """Images as large as possible, below them their colour bars, the table and whole notes.

    Without room for all, the first row of images is left, then without bars, table and notes.
    """
    if drawing.thumbnails:
        return _sheet(drawing, width, height, options)
    rows = visible_rows(drawing.plots, options)
    bars = _image_bars(drawing, rows, width, options)
    lines = 0 if drawing.table is None else wanted_lines(drawing.table)
    head = int(height >= _WITH_TITLE)
    first = _image_bars(drawing, rows[:1], width, options)
    for shown, above, below in ((rows, bars, lines), (rows[:1], first, lines)):
        space = height - head - len(above) - below
        if space >= _FEWEST_OF_IMAGE * len(shown):
            notes = _whole_notes(drawing.notes, shown, (width, space), options)
            break
    else:
        shown, above, below, notes = rows[:1], (), 0, []
        space = max(1, height - head)
    boxes = arrange_images(shown, width, space - len(notes))
    used = head + max((y + high for _, y, _, high in boxes), default=0)
    plots = [plot for row in shown for plot in row]
    places = tuple(_image_place(*each, head) for each in zip(plots, boxes, strict=False))
    top = used + len(above)
    texts = [(text_part(((line, options.theme.muted),)),) for line in notes]
    return DrawingLayout(places, (top, height - top - len(notes) if below else 0), tuple(texts),
                         above)  # fmt: skip


def _sheet(drawing: Drawing, width: int, height: int, options: RenderOptions) -> DrawingLayout:
    """Images as large as possible, each below its title, and their colour bars."""
    bars = _image_bars(drawing, [drawing.plots], width, options)
    boxes = arrange_images([drawing.plots], width, height - len(bars), thumbnails=True)
    places = tuple(
        PlotPlace(plot, x, x, wide, y, high, y - 1, None)
        for plot, (x, y, wide, high) in zip(drawing.plots, boxes, strict=False)
    )
    top = max((y + high for _, y, _, high in boxes), default=0) + len(bars)
    return DrawingLayout(places, (top, 0), (), bars)


def beside_images(
    drawing: Drawing, size: Size, options: RenderOptions
) -> tuple[tuple[Drawing, int, int], tuple[Drawing, int, int]] | None:
    """Images and their texts as drawings of their own, each with its first column and its width.

    None where images are not clearly larger with their table and notes beside them.
    """
    width, height = size
    room = width - _TEXT_COLUMNS - GAP
    has_images = any(plot.image is not None for plot in drawing.plots)
    if drawing.thumbnails or drawing.table is None or not has_images or room < _TEXT_COLUMNS:
        return None
    above = drawing_layout(drawing, size, options).plots
    beside = arrange_images(visible_rows(drawing.plots, options), room, height - 1)
    if not above or not beside:
        return None
    if beside[0][2] * beside[0][3] < _LARGER * above[0].width * above[0].rows:
        return None
    images, texts = Drawing(drawing.plots), replace(drawing, plots=())
    return (images, 0, room), (texts, room + GAP, _TEXT_COLUMNS)


def _image_place(plot: Plot, box: Box, head: int) -> PlotPlace:
    x, y, wide, high = box
    return PlotPlace(plot, x, x, wide, head + y, high, 0 if head and y == 0 else None, None)


def _image_bars(
    drawing: Drawing, shown: Sequence[Sequence[Plot]], width: int, options: RenderOptions
) -> Rows:
    """Rows of the colour bars of shown images, so short that they fit into one row if they can."""
    images = [plot.image for row in shown for plot in row if plot.image is not None]
    values = [each for image in images for each in (image.ground, image.overlay)]
    ramps = {each.ramp for each in values if isinstance(each, ImageValues)}
    notes = (note for note in drawing.notes if not isinstance(note, str))
    bars = [item for note in notes for item in note
            if isinstance(item, ColourBar) and item.ramp in ramps]  # fmt: skip
    for length in (16, 12, 8, 6, 12 if width >= 44 else 8):
        parts = [part for item in bars for part in _note_parts(item, width, options, length)]
        rows = tuple(map(tuple, fit_rows(parts, width)))
        if len(rows) <= 1:
            break
    return rows


def _whole_notes(
    notes: Sequence[Note], rows: Sequence[Sequence[Plot]], size: Size, options: RenderOptions
) -> list[str]:
    """The lines of texts that fit below images that keep most of their size in `size` cells."""
    width, space = size

    def area(free: int) -> int:
        boxes = arrange_images(rows, width, free)
        return boxes[0][2] * boxes[0][3] if boxes else 0

    texts = [wrap_text(options.printable(note), max(12, width), "  ")
             for note in notes if isinstance(note, str)]  # fmt: skip
    most = min(sum(map(len, texts)), space - _FEWEST_OF_IMAGE * len(rows))
    least = _KEPT_AREA * area(space)
    room = next((count for count in range(most, 0, -1) if area(space - count) >= least), 0)
    shown: list[str] = []
    for lines in texts:
        if len(shown) + len(lines) <= room:
            shown += lines
    return shown
