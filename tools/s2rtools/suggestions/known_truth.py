"""The values that a simulator should be found to need, where the real side is generated."""

from __future__ import annotations

import math

from s2rstore.geometry import camera_offset
from s2rstore.geometry.camera_offset import hfov
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rstore.run_inputs import run_render_change
from s2rtools.synthetic_world.dataset import WorldData


def true_values(store: Store, run: Run) -> dict[str, float]:
    """True differences of the real camera from the declared sim camera, by adjustment.

    Metres, degrees and degrees; adjustments of the run's real camera included. Empty where the
    data was not generated.
    """
    data = WorldData.of_store(store)
    if data is None:
        return {}
    move = run_render_change(store, run, "real")
    sim = data.camera("sim")
    real = data.camera("real").moved(move.height, move.pitch, move.zoom)
    width = data.recipe.frame
    return {
        camera_offset.HEIGHT: round(real.height - sim.height, 6),
        camera_offset.PITCH: round(math.degrees(real.lens.pitch - sim.lens.pitch), 6),
        camera_offset.FOV: round(hfov(real.lens, width) - hfov(sim.lens, width), 6),
    }
