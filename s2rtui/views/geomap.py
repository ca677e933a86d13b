"""The geo-map: where the instances stand, and the heat on the floor."""

from __future__ import annotations

from s2rtui import plots
from s2rtui.canvas import Canvas, Look, Size
from s2rtui.session import derive
from s2rtui.views.contract import Pane, Scene, View

_TOLD = {
    "colour": "truth coloured by shift",
    "glyph": "direction and size of both errors",
    "full": "sim, truth, real",
}


class MapView(View):
    name = "map"
    key = "2"
    pane: Pane = "centre"
    description = "geo-map: truth, predictions and heat on the floor plan"

    def told(self, scene: Scene) -> str:
        return _TOLD[scene.state.map_mode]

    def input(self, scene: Scene) -> plots.GeoMapInput:
        return derive.map_input(
            scene.store, scene.state, scene.resources.floor_plan, scene.resources.grid
        )

    def draw(self, scene: Scene, size: Size, look: Look) -> Canvas:
        return plots.geomap(self.input(scene), size, look, scene.state.viewport)
