"""Adjustments of camera and lights, for which the data set's renderer renders frames again."""

from __future__ import annotations

from s2rstore.geometry import camera_offset
from s2rtools.adjustments.adjustment import RenderedAdjustment

HEIGHT = RenderedAdjustment(
    camera_offset.HEIGHT, -0.5, 1.0, 0.0, 0.02, "m", "camera higher above the floor"
)
PITCH = RenderedAdjustment(
    camera_offset.PITCH, -30.0, 30.0, 0.0, 1.0, "degrees", "camera pitched up"
)
FOV = RenderedAdjustment(
    camera_offset.FOV, -30.0, 30.0, 0.0, 1.0, "degrees", "wider horizontal field of view"
)
LAMPS = RenderedAdjustment(
    camera_offset.LAMPS, 0.0, 2.0, 1.0, 0.05, "factor", "light of the lamps times the factor"
)
WINDOWS = RenderedAdjustment(
    camera_offset.WINDOWS, 0.0, 2.0, 1.0, 0.05, "factor", "light of the windows times the factor"
)
