"""One instance on paper: images of sim and real with heat, depth, scales and numbers."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas import LIGHT, Pixels, Theme, diverging, turbo
from s2rtui.canvas.colour import NO_DEPTH, depth_tint
from s2rtui.charts.shared.image_pair_model import (
    InstanceInput,
    InstanceModel,
    SideView,
    instance_model,
    panel_pixels,
)
from s2rtui.charts.shared.paper import (
    LETTER,
    Page,
    draw_colour_bar,
    draw_heading,
    figure_bytes,
    make_page,
    new_figure,
    rgb_fractions,
)
from s2rtui.charts.shared.paper import Pixels as Size

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIDE = 2.9
"""Width of scales and numbers at the right, inches."""


def instance_figure(
    data: InstanceInput,
    size: Size = (1600, 1200),
    theme: Theme = LIGHT,
    run: str = "",
    title: str = "",
) -> bytes:
    """Draw the figure in `size` pixels."""
    page = make_page(size, theme)
    model = instance_model(data)
    figure = new_figure(page)
    name = f"{run}: instance {data.iid}" if run else f"Instance {data.iid}"
    top = draw_heading(figure, page, title or name, model.heat_name and f"heat: {model.heat_name}")
    kinds = ["rgb"]
    if data.sim.depth is not None or data.real.depth is not None:
        kinds.append("depth")
    wide, _ = page.inches
    side = SIDE if wide > 6 else 0.0
    gap = 0.12
    aspect = data.sim.rgb.shape[1] / max(1, data.sim.rgb.shape[0])
    high = max(0.2, (top - 0.3 - 0.25 - gap * (len(kinds) - 1)) / len(kinds))
    high = min(high, max(0.2, (wide - side - 0.65 - gap) / 2 / aspect))
    across = high * aspect
    for row, what in enumerate(kinds):
        bottom = top - 0.25 - (row + 1) * high - row * gap
        for column, (role, shown) in enumerate((("sim", data.sim), ("real", data.real))):
            box = (0.42 + column * (across + gap), bottom, across, high)
            label = (shown.title or role) if row == 0 else ""
            _picture(figure, page, box, what, shown, data, model)
            if label:
                _caption(figure, page, box, label, theme.sim if column == 0 else theme.real)
        _row_name(figure, page, bottom + high / 2, "image" if what == "rgb" else what)
    if side:
        left = 0.42 + 2 * across + gap + 0.35
        _scales(figure, page, data, model, left, top - 0.25, min(2.1, high * 0.62))
        _numbers(figure, page, data, model, left, top - 0.25 - min(2.1, high * 0.62) - 0.75)
    return figure_bytes(figure, page)


def _picture(
    figure: Figure,
    page: Page,
    box: tuple[float, float, float, float],
    what: str,
    side: SideView,
    data: InstanceInput,
    model: InstanceModel,
) -> None:
    axes = figure.add_axes(page.box(*box))
    axes.set_axis_off()
    if what == "depth" and side.depth is None:
        axes.text(
            0.5, 0.5, "no depth", ha="center", va="center", color=rgb_fractions(page.theme.muted)
        )
        return
    rows, columns = side.rgb.shape[:2]
    pixels = panel_pixels(side, what, model, data, (rows, columns))
    axes.imshow(pixels, interpolation="antialiased", aspect="auto")


def _caption(
    figure: Figure,
    page: Page,
    box: tuple[float, float, float, float],
    text: str,
    ink: tuple[int, int, int],
) -> None:
    wide, high = page.inches
    label = figure.text(
        box[0] / wide,
        (box[1] + box[3] + 0.06) / high,
        text,
        ha="left",
        va="bottom",
        fontsize=11,
        fontweight="bold",
    )
    label.set_color(rgb_fractions(ink))


def _row_name(figure: Figure, page: Page, middle: float, text: str) -> None:
    wide, high = page.inches
    label = figure.text(
        0.27 / wide, middle / high, text, ha="center", va="center", rotation=90, fontsize=9
    )
    label.set_color(rgb_fractions(page.theme.muted))


def _scales(
    figure: Figure,
    page: Page,
    data: InstanceInput,
    model: InstanceModel,
    left: float,
    top: float,
    high: float,
) -> None:
    """Draw the colour bars side by side."""

    def heat(shares: NDArray[np.float64]) -> Pixels:
        return diverging(2 * shares - 1, (236, 236, 236)) if data.signed else turbo(shares)

    if model.heat_range is not None:
        name = f"heat ({data.unit})" if data.unit else "heat"
        box = page.box(left, top - high - 0.2, 0.16, high)
        draw_colour_bar(figure, page, box, model.heat_range, name, heat)
        left += 1.3
    if model.depth_range is not None:
        box = page.box(left, top - high - 0.2, 0.16, high)
        draw_colour_bar(figure, page, box, model.depth_range, "depth (m)", depth_tint)
        patch = figure.add_axes(page.box(left, top - high - 0.5, 0.16, 0.16))
        patch.set_axis_off()
        patch.imshow(np.array([[NO_DEPTH]], dtype=np.uint8), aspect="auto")
        place = ((left + 0.24) / page.inches[0], (top - high - 0.42) / page.inches[1])
        label = figure.text(*place, "no depth", fontsize=8, va="center")
        label.set_color(rgb_fractions(page.theme.muted))


def _numbers(
    figure: Figure, page: Page, data: InstanceInput, model: InstanceModel, left: float, top: float
) -> None:
    """Write poses and errors as a table, then the notes."""
    wide, high = page.inches
    theme = page.theme
    inks = {"truth": theme.truth, "sim": theme.sim, "real": theme.real}

    def put(x: float, y: float, text: str, ink: tuple[int, int, int], **style: object) -> None:
        label = figure.text(x / wide, y / high, text, fontsize=9, va="top")
        label.set(color=rgb_fractions(ink), **style)

    columns = (0.92, 1.42, 2.02)
    room = max(12, int((wide - left - 0.1) / (9 * LETTER)))
    for x, name in zip(columns, ("x (m)", "y (m)", "heading"), strict=True):
        put(left + x, top, name, theme.muted, ha="right")
    for line in model.poses:
        top -= 0.24
        put(left, top, line.role, inks[line.role], fontweight="bold")
        texts = (line.cells[0], line.cells[1], f"{line.cells[2]}°")
        for x, text in zip(columns, texts, strict=True):
            put(left + x, top, text.replace("-", "−"), theme.text, ha="right")
    top -= 0.4
    errors = [line for line in model.poses if line.role != "truth"]
    for x, name in zip(columns[1:], ("error (m)", "heading"), strict=True):
        put(left + x, top, name if errors else "", theme.muted, ha="right")
    for line in errors:
        top -= 0.24
        put(left, top, f"{line.role} error", inks[line.role], fontweight="bold")
        turn = f"{line.cells[4]}°".replace("n/a°", "n/a")
        for x, text in zip(columns[1:], (line.cells[3], turn), strict=True):
            put(left + x, top, text, theme.text, ha="right")
    top -= 0.16
    for name, value in data.notes:
        for part in textwrap.wrap(f"{name}  {value}", room, subsequent_indent="    "):
            top -= 0.22
            put(left, top, part, theme.muted)
