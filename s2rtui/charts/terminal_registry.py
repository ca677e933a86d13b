"""Views as pure functions: numbers in, a canvas out; each with the model that paper shares."""

from s2rtui.analysis.map_frame import MapFrame, fit, panned, sample, zoomed
from s2rtui.canvas.brush_surface import Mark, Panel, draw_mark, panel_at
from s2rtui.canvas.pending_brush import arc_of, range_of, steps_of
from s2rtui.charts.compare.model import DifferenceModel, DifferenceSummary, difference_model
from s2rtui.charts.compare.terminal import difference, difference_layout, difference_surface
from s2rtui.charts.errors.model import HistogramModel, histogram_model
from s2rtui.charts.errors.terminal import (
    HistogramLayout,
    histogram,
    histogram_layout,
    histogram_surface,
)
from s2rtui.charts.history.model import HistoryInput, HistoryModel, history_model
from s2rtui.charts.history.terminal import HistoryLayout, history, history_layout
from s2rtui.charts.instance.model import InstanceModel, instance_model
from s2rtui.charts.instance.terminal import InstanceLayout, instance, instance_layout
from s2rtui.charts.map.model import GeoMapModel, geomap_model
from s2rtui.charts.map.terminal import geomap, geomap_layout, geomap_surface
from s2rtui.charts.orientation.model import OrientationModel, orientation_model
from s2rtui.charts.orientation.terminal import (
    OrientationLayout,
    orientation,
    orientation_layout,
    orientation_surface,
)
from s2rtui.charts.overview.layout import OverviewLayout, overview_layout, overview_surface
from s2rtui.charts.overview.model import OverviewModel, overview_model
from s2rtui.charts.overview.terminal import overview
from s2rtui.charts.rooms.model import RoomsModel, rooms_model
from s2rtui.charts.rooms.terminal import RoomsLayout, rooms, rooms_layout, rooms_surface
from s2rtui.charts.shared.inputs import (
    DifferenceInput,
    GeoMapInput,
    HistogramInput,
    InstanceInput,
    MapMode,
    OrientationInput,
    OverviewLines,
    OverviewRow,
    PoseNumbers,
    RoomsInput,
    SideView,
    UmapInput,
)
from s2rtui.charts.shared.map_layout import GeoMapLayout
from s2rtui.charts.umap.model import UmapModel, umap_model
from s2rtui.charts.umap.terminal import UmapLayout, umap, umap_layout, umap_surface

__all__ = [
    "DifferenceInput",
    "DifferenceModel",
    "DifferenceSummary",
    "GeoMapInput",
    "GeoMapLayout",
    "GeoMapModel",
    "HistogramInput",
    "HistogramLayout",
    "HistogramModel",
    "HistoryInput",
    "HistoryLayout",
    "HistoryModel",
    "InstanceInput",
    "InstanceLayout",
    "InstanceModel",
    "MapFrame",
    "MapMode",
    "Mark",
    "OrientationInput",
    "OrientationLayout",
    "OrientationModel",
    "OverviewLayout",
    "OverviewLines",
    "OverviewModel",
    "OverviewRow",
    "Panel",
    "PoseNumbers",
    "RoomsInput",
    "RoomsLayout",
    "RoomsModel",
    "SideView",
    "UmapInput",
    "UmapLayout",
    "UmapModel",
    "arc_of",
    "difference",
    "difference_layout",
    "difference_model",
    "difference_surface",
    "draw_mark",
    "fit",
    "geomap",
    "geomap_layout",
    "geomap_model",
    "geomap_surface",
    "histogram",
    "histogram_layout",
    "histogram_model",
    "histogram_surface",
    "history",
    "history_layout",
    "history_model",
    "instance",
    "instance_layout",
    "instance_model",
    "orientation",
    "orientation_layout",
    "orientation_model",
    "orientation_surface",
    "overview",
    "overview_layout",
    "overview_model",
    "overview_surface",
    "panel_at",
    "panned",
    "range_of",
    "rooms",
    "rooms_layout",
    "rooms_model",
    "rooms_surface",
    "sample",
    "steps_of",
    "umap",
    "umap_layout",
    "umap_model",
    "umap_surface",
    "zoomed",
]
