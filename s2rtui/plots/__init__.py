"""Views as pure functions: numbers in, a canvas out; each with the model that paper shares."""

from s2rtui.plots.frame import MapFrame, fit, panned, sample, zoomed
from s2rtui.plots.geomap import GeoMapLayout, geomap, geomap_layout
from s2rtui.plots.geomap_model import GeoMapModel, geomap_model
from s2rtui.plots.histogram import HistogramModel, histogram, histogram_model
from s2rtui.plots.inputs import (
    GeoMapInput,
    HistogramInput,
    InstanceInput,
    MapMode,
    OverviewRow,
    PoseNumbers,
    SideView,
)
from s2rtui.plots.instance import InstanceLayout, instance, instance_layout
from s2rtui.plots.instance_model import InstanceModel, instance_model
from s2rtui.plots.overview import (
    OverviewLayout,
    OverviewModel,
    overview,
    overview_layout,
    overview_model,
)

__all__ = [
    "GeoMapInput",
    "GeoMapLayout",
    "GeoMapModel",
    "HistogramInput",
    "HistogramModel",
    "InstanceInput",
    "InstanceLayout",
    "InstanceModel",
    "MapFrame",
    "MapMode",
    "OverviewLayout",
    "OverviewModel",
    "OverviewRow",
    "PoseNumbers",
    "SideView",
    "fit",
    "geomap",
    "geomap_layout",
    "geomap_model",
    "histogram",
    "histogram_model",
    "instance",
    "instance_layout",
    "instance_model",
    "overview",
    "overview_layout",
    "overview_model",
    "panned",
    "sample",
    "zoomed",
]
