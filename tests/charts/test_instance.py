"""The instance view: image panels, heatmap overlay, scales and numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from s2rtui.canvas import ColourMode, RenderOptions
from s2rtui.canvas.colour import NO_DEPTH
from s2rtui.charts.shared.heat_colours import heat_colours
from s2rtui.charts.shared.image_pair_model import instance_model, panel_pixels
from s2rtui.charts.shared.image_pair_terminal import draw_instance, instance_layout
from tests.charts.examples import instance_input, side


def test_sim_and_real_panels_have_the_same_size_side_by_side() -> None:
    panels = instance_layout(instance_input(), (60, 50)).panels
    for what in ("rgb", "depth"):
        sim, real = (panel for panel in panels if panel.what == what)
        assert (sim.side, real.side) == ("sim", "real")
        assert sim.x + sim.width <= real.x
        assert (sim.y, sim.width, sim.height) == (real.y, real.width, real.height)


@pytest.mark.parametrize("size", [(36, 38), (60, 50), (80, 22), (150, 30)])
def test_panels_fit_and_keep_the_aspect_ratio(size: tuple[int, int]) -> None:
    layout = instance_layout(instance_input(), size)
    assert layout.panels
    for panel in layout.panels:
        assert panel.x + panel.width <= size[0]
        assert panel.y + panel.height <= size[1]
        assert panel.width == pytest.approx(2 * panel.height, abs=2)


def test_signed_scale_is_symmetric_and_shared() -> None:
    model = instance_model(instance_input())
    assert model.heat_range is not None
    low, high = model.heat_range
    assert low == -high
    both = np.concatenate([side(1).heat.ravel(), side(2).heat.ravel()])  # type: ignore[union-attr]
    assert high == pytest.approx(np.abs(both).max())


def test_unsigned_scale_starts_at_zero() -> None:
    model = instance_model(instance_input(signed=False, sim=side(1, heat=False)))
    assert model.heat_range is not None
    assert model.heat_range[0] <= 0


def test_zero_heat_is_transparent() -> None:
    colours, opacity = heat_colours(np.array([[0.0, 1.0, np.nan]]), (-1.0, 1.0), signed=True)
    assert colours.shape == (1, 3, 3)
    assert opacity[0, 0] == 0
    assert opacity[0, 1] > 0.7
    assert opacity[0, 2] == 0


def test_invalid_depth_has_a_separate_colour() -> None:
    view = instance_input()
    pixels = panel_pixels(view.sim, "depth", instance_model(view), view, (32, 32))
    assert (pixels[:4] == NO_DEPTH).all()
    assert not (pixels[4:] == NO_DEPTH).all(axis=-1).any()


def test_numbers_are_metres_and_degrees() -> None:
    text = "\n".join(draw_instance(instance_input(), (60, 50)).lines())
    for number in ("1.50", "-2.25", "28.6", "0.75", "5.7", "22.9"):
        assert number in text
    assert "occlusion rgb" in text
    assert "#12" in text
    assert "größer" in text


def test_negative_zero_and_nan_are_formatted() -> None:
    model = instance_model(instance_input(truth=(-0.001, float("nan"), 0.0)))
    assert model.poses[0].cells[:3] == ("0.00", "n/a", "0.0")


@pytest.mark.parametrize(
    "options", [RenderOptions(ascii=True), RenderOptions(mode=ColourMode.NONE)]
)
def test_heat_is_drawn_as_digits_and_letters_without_colours(options: RenderOptions) -> None:
    view = instance_input()
    layout = instance_layout(view, (60, 60), options)
    heat = [panel for panel in layout.panels if panel.what == "heat"]
    assert len(heat) == 2
    canvas = draw_instance(view, (60, 60), options)
    panel = heat[0]
    part = canvas.char[panel.y : panel.y + panel.height, panel.x : panel.x + panel.width]
    assert set(part.ravel()) <= set("ihgfedcba.123456789")


def test_a_side_without_depth_shows_a_note() -> None:
    text = "\n".join(draw_instance(instance_input(real=side(2, depth=False)), (60, 50)).lines())
    assert "no depth" in text


def test_a_translated_side_shows_the_original_below() -> None:
    real = side(2)
    translated = replace(real, original=255 - real.rgb)
    data = instance_input(real=translated)
    kinds = [panel.what for panel in instance_layout(data, (60, 60)).panels]
    assert kinds == ["rgb", "rgb", "original", "original", "depth", "depth"]
    text = "\n".join(draw_instance(data, (60, 60)).lines())
    assert text.count("original") == 1
    assert "not translated" in text
    model, shape = instance_model(data), real.rgb.shape[:2]
    drawn = panel_pixels(translated, "original", model, data, (shape[0], shape[1]))
    assert (drawn == 255 - real.rgb).all()
