"""One instance on paper: images of sim and real with heat, depth, scales and numbers."""

from __future__ import annotations

import textwrap

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.canvas.colour import NO_DEPTH, depth_tint
from s2rtui.charts.shared.image_pair_model import (
    InstanceInput,
    InstanceModel,
    SideView,
    instance_model,
    panel_pixels,
)
from s2rtui.drawing.heat_colours import heat_ramp
from s2rtui.drawing.page import (
    LETTER,
    SMALLEST,
    Box,
    Page,
    Pixels,
    draw_colour_bar,
    label_with_unit,
    new_page,
    own_settings,
    value_colours,
    wrapped_label,
)

SIDE = 2.9
"""Width of scales and numbers at the right, inches."""
BELOW = 6.0
"""Height of scales and numbers below the images of a narrow page, inches."""
SCALE_LETTERS = 16
"""Letters of a line above a scale."""


@own_settings()
def instance_figure(
    data: InstanceInput, size: Pixels, theme: Theme = LIGHT, title: str = ""
) -> bytes:
    """Draw the figure in `size` pixels."""
    model = instance_model(data)
    heat = model.heat_name and f"heat: {model.heat_name}"
    page = new_page(size, theme, title, heat)
    top, (wide, _) = page.top, page.inches
    has_depth = data.sim.depth is not None or data.real.depth is not None
    is_translated = any(side.original is not None for side in (data.sim, data.real))
    kinds = ["rgb", *["original"] * is_translated, *["depth"] * has_depth]
    side = SIDE if wide > 6 else 0.0
    below = BELOW if SMALLEST < wide <= 6 and page.is_paper else 0.0
    gap = 0.12
    rows, columns = (data.sim if data.sim.rgb.size else data.real).rgb.shape[:2]
    aspect = columns / max(1, rows)
    high = max(0.2, (top - below - 0.3 - 0.25 - gap * (len(kinds) - 1)) / len(kinds))
    high = min(high, max(0.2, (wide - side - 0.65 - gap) / 2 / aspect))
    across = high * aspect
    for row, what in enumerate(kinds):
        bottom = top - 0.25 - (row + 1) * high - row * gap
        for column, (role, shown) in enumerate((("sim", data.sim), ("real", data.real))):
            left = 0.42 + column * (across + gap)
            _draw_image(page, (left, bottom, across, high), what, shown, data, model)
            if row == 0:
                ink, y = getattr(page.inks, role), bottom + high + 0.06
                page.text(left, y, shown.title or role, ink, 11, va="bottom", fontweight="bold")
        centred = {"ha": "center", "va": "center", "rotation": 90}
        name = "image" if what == "rgb" else what
        page.text(0.27, bottom + high / 2, name, page.inks.muted, 9, **centred)
    if side:
        left, bar = 0.42 + 2 * across + gap + 0.35, min(2.1, high * 0.62)
        _draw_scales(page, data, model, left, top - 0.25, bar)
        _write_numbers(page, data, model, left, top - 0.25 - bar - 0.75)
    elif below:
        foot = bottom - 0.35
        _draw_scales(page, data, model, 0.3, foot, 1.1)
        _write_numbers(page, data, model, 0.3, foot - 1.1 - 0.75)
    return page.encoded()


def _draw_image(
    page: Page, box: Box, what: str, side: SideView, data: InstanceInput, model: InstanceModel
) -> None:
    axes = page.axes(*box)
    axes.set_axis_off()
    missing = {
        "rgb": (side.rgb.size, "no image"),
        "original": (side.original is not None, "not translated"),
        "depth": (side.depth is not None, "no depth"),
    }
    present, text = missing[what]
    if not present:
        axes.text(0.5, 0.5, text, ha="center", va="center", color=page.inks.muted)
        return
    rows, columns = side.rgb.shape[:2]
    pixels = panel_pixels(side, what, model, data, (rows, columns), unsigned_colours=value_colours)
    axes.imshow(pixels, interpolation="antialiased", aspect="auto")


def _draw_scales(
    page: Page, data: InstanceInput, model: InstanceModel, left: float, top: float, high: float
) -> None:
    """Draw the colour bars side by side."""
    bottom = top - high - 0.2
    if model.heat_range is not None:
        name = wrapped_label(label_with_unit(model.heat_name or "heat", data.unit), SCALE_LETTERS)
        heat_high = max(0.3, high - 0.16 * name.count("\n"))
        ramp = heat_ramp(data.signed, value_colours)
        heat_scale = model.heat_range, name, ramp, data.heat_range is not None
        draw_colour_bar(page, left, bottom, heat_high, *heat_scale)
        left += 1.5
    if model.depth_range is not None:
        draw_colour_bar(page, left, bottom, high, model.depth_range, "depth (m)", depth_tint)
        patch = page.axes(left, top - high - 0.5, 0.16, 0.16)
        patch.set_axis_off()
        patch.imshow(np.array([[NO_DEPTH]], dtype=np.uint8), aspect="auto")
        page.text(left + 0.24, top - high - 0.42, "no depth", page.inks.muted, 8, va="center")


def _write_numbers(
    page: Page, data: InstanceInput, model: InstanceModel, left: float, top: float
) -> None:
    """Write poses and errors as a table, then the notes."""
    muted, text_ink = page.inks.muted, page.inks.text
    shift = 0.4 if len(data.truths) > 1 else 0.0
    columns = (0.92 + shift, 1.42 + shift, 2.02 + shift)

    def put_row(*texts: str, ink: tuple[float, float, float] = text_ink) -> None:
        for x, text in zip(columns[-len(texts) :], texts, strict=True):
            page.text(left + x, top, text, ink, 9, va="top", ha="right")

    def put_name(role: str, name: str) -> None:
        page.text(left, top, name, getattr(page.inks, role), 9, va="top", fontweight="bold")

    if model.poses:
        put_row("x (m)", "y (m)", "heading", ink=muted)
    for line in model.poses:
        top -= 0.24
        put_name(line.role, line.label)
        x, y, heading = (text.replace("-", "−") for text in line.cells[:3])
        put_row(x, y, f"{heading}°")
    top -= 0.4
    errors = [line for line in model.poses if line.role != "truth"]
    if errors:
        put_row("error (m)", "heading", ink=muted)
    for line in errors:
        top -= 0.24
        put_name(line.role, f"{line.role} error")
        put_row(line.cells[3], f"{line.cells[4]}°".replace("n/a°", "n/a"))
    top -= 0.16
    room = max(12, int((page.inches[0] - left - 0.1) / (9 * LETTER)))
    for name, value in data.notes:
        for part in textwrap.wrap(f"{name}  {value}", room, subsequent_indent="    "):
            top -= 0.22
            page.text(left, top, part, muted, 9, va="top")
