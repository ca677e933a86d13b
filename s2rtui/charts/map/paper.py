"""The geo-map on paper: floor plan, heat, poses, errors, with scales in metres."""

from __future__ import annotations

from s2rstore.records import Bounds
from s2rtui.canvas.colour import LIGHT, Rgb, Theme, turbo
from s2rtui.charts.map.paper_error_glyphs import draw_wedges, wedge_legend
from s2rtui.charts.map.paper_points import (
    draw_cursor,
    draw_others,
    draw_predictions,
    draw_values,
)
from s2rtui.charts.shared.inputs import GeoMapInput
from s2rtui.charts.shared.map_model import GeoMapModel, default_view, geomap_model
from s2rtui.charts.shared.paper import Pixels, broken, colour_scale, page_of, written
from s2rtui.charts.shared.paper_map import MapSheet, map_sheet, marker_legend

WHAT = {"full": "predicted and true positions", "glyph": "direction and size of the errors"}


def geomap_figure(
    view: GeoMapInput,
    size: Pixels = (1600, 1200),
    theme: Theme = LIGHT,
    run: str = "",
    subtitle: str = "",
    title: str = "",
    viewport: Bounds | None = None,
) -> bytes:
    """A PNG of `size` pixels; the heading names the run and what is shown."""
    page = page_of(size, theme)
    model = geomap_model(view)
    area = viewport or default_view(view.bounds, view.truth, view.valid)
    sheet = map_sheet(view.ground, area, page, title or _title(view, run), subtitle)
    draw_others(sheet.axes, view.truth, model.chosen, sheet.spots)
    if view.mode == "full":
        draw_predictions(sheet.axes, view, model, sheet.spots)
    elif view.mode == "glyph":
        draw_wedges(sheet, view, model)
    else:
        draw_values(sheet.axes, view, model, sheet.spots)
    draw_cursor(sheet.axes, view, model, theme, area)
    if sheet.side:
        _side(sheet, view, model, sheet.side)
    return written(sheet.figure, page)


def _title(view: GeoMapInput, run: str) -> str:
    what = WHAT.get(view.mode, view.value_label)
    what = f"{what} and {view.heat_label}" if view.heat is not None else what
    return f"{run}: {what}" if run else what[:1].upper() + what[1:]


def _side(
    sheet: MapSheet, view: GeoMapInput, model: GeoMapModel, corner: tuple[float, float]
) -> None:
    """Colour bars and legend, one under the other from `corner` (inches) downwards."""
    left, top = corner
    page = sheet.page
    high = min(2.0, (top - 0.6) * 0.33)
    gap = 0.32
    line = 0.17
    if view.mode == "colour":
        label = f"{view.value_label} ({view.value_unit})" if view.value_unit else view.value_label
        box = page.box(left, top - gap - high, 0.16, high)
        colour_scale(sheet.figure, page, box, model.value_range, label, turbo)
        top -= high + gap + 0.25
    if model.heat_range is not None:
        label = f"{view.heat_label} ({view.heat_unit})" if view.heat_unit else view.heat_label
        label = broken(label)
        gap += line * label.count("\n")
        box = page.box(left, top - gap - high, 0.16, high)
        colour_scale(sheet.figure, page, box, model.heat_range, label, turbo)
        top -= high + gap + 0.25
    marker_legend(sheet, _marks(view, model, page.theme), (left, top))


def _marks(view: GeoMapInput, model: GeoMapModel, theme: Theme) -> list[tuple[str, str, Rgb, bool]]:
    marks: list[tuple[str, str, Rgb, bool]] = []
    if view.mode == "full":
        marks = [
            ("sim prediction", "D", theme.sim, True),
            ("real prediction", "D", theme.real, False),
            ("ground truth", "o", theme.truth, True),
        ]
    elif view.mode == "glyph":
        marks = wedge_legend(view, model, theme)
    if model.others:
        marks.append(("not selected", ".", theme.unselected, True))
    if model.cursor is not None:
        marks.append((f"instance {model.cursor}", "o", theme.cursor, False))
    if view.clip is not None:
        marks.append(("dimmed: not seen", "s", theme.faint, False))
    return marks
