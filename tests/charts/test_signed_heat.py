"""Heat with a sign on the map: blue below 0, orange above, transparent at 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.charts.map.terminal import draw_map, map_layout
from s2rtui.charts.shared.base_map_model import MapInput, map_model
from s2rtui.charts.shared.heat_colours import heat_ramp, map_opacity
from tests.charts.examples import map_input

SIZE = (80, 26)


def signed_map(**changes: object) -> MapInput:
    """A map whose left, middle and right thirds have heat -1, 0 and 1 without other marks."""
    heat = np.repeat([-1.0, 0.0, 1.0], 10)[None].repeat(15, axis=0)
    plain = {"floor_plan": None, "rooms": (), "cursor": None, "heat_is_signed": True}
    return map_input(**{"heat": heat, **plain, **changes})


def thirds(view: MapInput, pixels: NDArray[np.uint8]) -> list[list[int]]:
    """The colours of the thirds of an image (h, w, 3) that the map fills."""
    frame = map_layout(view, SIZE).frame
    places = frame.to_cells([[x, 9.0] for x in (3.0, 10.0, 17.0)])
    scale = pixels.shape[1] / frame.width
    return [pixels[int(y * scale / 2), int(x * scale)].tolist() for x, y in places]


def test_signed_heat_on_the_map_is_blue_and_orange_and_transparent_at_0() -> None:
    view = signed_map()
    canvas, layout = draw_map(view, SIZE), map_layout(view, SIZE)
    rows = np.repeat(canvas.bg[:, layout.x : layout.x + layout.frame.width], 2, axis=0)
    low, zero, high = thirds(view, np.asarray(rows[layout.y :]))
    assert low[2] > low[0] + 80
    assert tuple(zero) == DARK.background
    assert high[0] > high[2] + 80


def test_signed_heat_of_one_sign_keeps_its_colour() -> None:
    view = signed_map(heat=np.full((15, 30), -0.5))
    assert map_model(view).heat_range == (-0.5, 0.5)


def test_signed_heat_without_colours_differs_by_its_glyphs() -> None:
    for ascii in (True, False):
        options = RenderOptions(mode=ColourMode.NONE, ascii=ascii)
        lines = draw_map(signed_map(), SIZE, options).lines()
        assert "MMMM" in lines[2]
        assert "%%%%" in lines[2]
        assert lines[2].index("MMMM") < lines[2].index("%%%%")


def test_signed_heat_on_paper_is_transparent_at_0() -> None:
    shares = np.array([0.0, 0.5, 1.0, np.nan])
    assert map_opacity(shares, True).tolist() == [0.86, 0.0, 0.86, 0.0]
    assert map_opacity(shares, False)[0] > 0
    (blue, _, orange) = heat_ramp(True)(shares[:3]).tolist()
    assert blue[2] > blue[0]
    assert orange[0] > orange[2]
