"""The geo-map: floor plan, heat, poses and errors from above, in cells."""

from __future__ import annotations

from s2rstore.records import Bounds
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas.brush import Panel, draw_mark
from s2rtui.canvas.canvas import Canvas, Size
from s2rtui.canvas.render_options import RenderOptions
from s2rtui.charts.map.error_arcs import draw_glyphs, glyph_legend
from s2rtui.charts.map.points import (
    draw_cursor,
    draw_live,
    draw_others,
    draw_predictions,
    draw_values,
)
from s2rtui.charts.shared.inputs import GeoMapInput
from s2rtui.charts.shared.legend import (
    LegendPart,
    colour_bar,
    draw_rows,
    ramp_for_values,
    scale_bar,
    words,
)
from s2rtui.charts.shared.map_background import HEAT_RAMPS, draw_ground, draw_names
from s2rtui.charts.shared.map_model import (
    LINES_UP_TO,
    GeoMapModel,
    default_view,
    geomap_model,
)
from s2rtui.charts.shared.map_terminal import GeoMapLayout, draw_axes, map_layout, map_panel


def geomap_layout(
    view: GeoMapInput,
    size: Size,
    viewport: Bounds | None = None,
    look: RenderOptions | None = None,
    model: GeoMapModel | None = None,
) -> GeoMapLayout:
    """Where the map stands in `size`; `viewport` is a world rectangle (default: the bounds)."""
    look, model = look or RenderOptions(), model or geomap_model(view)
    area = viewport or default_view(view.bounds, view.truth, view.valid)

    def legend(frame: MapFrame, width: int) -> list[LegendPart]:
        return _legend(view, model, frame, width, look)

    return map_layout(area, view.y_down, size, legend)


def geomap_surface(
    view: GeoMapInput, size: Size, look: RenderOptions | None = None, viewport: Bounds | None = None
) -> tuple[Panel, ...]:
    """One panel "map", a plane of metres."""
    return (map_panel(geomap_layout(view, size, viewport, look)),)


def geomap(
    view: GeoMapInput, size: Size, look: RenderOptions | None = None, viewport: Bounds | None = None
) -> Canvas:
    """The view in `size` (columns, rows) through `viewport`, a world rectangle."""
    look = look or RenderOptions()
    canvas = Canvas(*size, theme=look.theme)
    model = geomap_model(view)
    layout = geomap_layout(view, (canvas.width, canvas.height), viewport, look, model)
    frame = layout.frame
    chart = Canvas(layout.width, layout.height, look.theme)
    draw_ground(chart, view.ground, frame, look)
    draw_others(chart, view.truth, model.chosen, frame, look)
    draw_names(chart, view.ground.rooms, frame, look)
    draw_selected = {"colour": draw_values, "glyph": draw_glyphs, "full": draw_predictions}
    draw_selected[view.mode](chart, view, model, frame, look)
    draw_live(chart, view.live, frame, look)
    draw_cursor(chart, view, model.cursor, frame, look)
    canvas.paste(chart, layout.x, layout.y)
    if layout.axes:
        draw_axes(canvas, layout, look)
    draw_rows(canvas, layout.x, layout.height + int(layout.axes), layout.legend)
    draw_mark(canvas, map_panel(layout), view.mark, look)
    return canvas


def _legend(
    view: GeoMapInput, model: GeoMapModel, frame: MapFrame, width: int, look: RenderOptions
) -> list[LegendPart]:
    bar = 12 if width >= 50 else 8
    parts: list[LegendPart] = []
    if view.mode == "full":
        parts.append(_marks(look))
    elif view.mode == "glyph":
        parts += glyph_legend(view, model, look)
    else:
        parts.append(
            colour_bar(
                view.value_label,
                view.value_unit,
                model.value_range,
                look,
                bar,
                ramp=ramp_for_values(look),
                room=width,
                clipped=view.value_range is None,
            )
        )
    if model.heat_range is not None:
        ramp = None if look.fine else HEAT_RAMPS[look.ascii]
        parts.append(
            colour_bar(
                view.heat_label, view.heat_unit, model.heat_range, look, bar, ramp=ramp, room=width
            )
        )
    parts.append(scale_bar(frame.pitch, max(4, width // 6), look))
    if model.others:
        parts.append(others_part(look))
    if view.mode == "full" and model.lit > LINES_UP_TO:
        parts.append(words(((f"lines up to {LINES_UP_TO} in view", look.theme.muted),)))
    if view.clip is not None:
        parts.append(clip_part(look))
    return parts


def _marks(look: RenderOptions) -> LegendPart:
    theme, glyphs = look.theme, look.glyphs
    return words(
        (
            (f"{glyphs.sim} ", theme.sim),
            ("sim  ", theme.muted),
            (f"{glyphs.real} ", theme.real),
            ("real  ", theme.muted),
            (f"{glyphs.truth} ", theme.truth),
            ("truth", theme.muted),
        )
    )


def others_part(look: RenderOptions) -> LegendPart:
    """The legend of what is not selected."""
    theme = look.theme
    grey = "⠿" if not look.ascii else look.glyphs.unselected
    return words(((f"{grey} ", theme.unselected), ("not selected", theme.muted)))


def clip_part(look: RenderOptions) -> LegendPart:
    """The legend of what no selected instance has seen."""
    how = "dim" if look.fine else "blank"
    return words(((f"{how}: not seen", look.theme.muted),))
