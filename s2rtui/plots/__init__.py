"""Views as pure functions: numbers in, a canvas out; each with the model that paper shares."""

from s2rtui.plots.difference import difference, difference_layout, difference_surface
from s2rtui.plots.difference_model import DifferenceModel, DifferenceSummary, difference_model
from s2rtui.plots.frame import MapFrame, fit, panned, sample, zoomed
from s2rtui.plots.geomap import geomap, geomap_layout, geomap_surface
from s2rtui.plots.geomap_layout import GeoMapLayout
from s2rtui.plots.geomap_model import GeoMapModel, geomap_model
from s2rtui.plots.histogram import HistogramModel, histogram, histogram_model
from s2rtui.plots.inputs import (
    DifferenceInput,
    GeoMapInput,
    HistogramInput,
    InstanceInput,
    MapMode,
    OverviewLines,
    OverviewRow,
    PoseNumbers,
    SideView,
)
from s2rtui.plots.instance import InstanceLayout, instance, instance_layout
from s2rtui.plots.instance_model import InstanceModel, instance_model
from s2rtui.plots.overview import overview
from s2rtui.plots.overview_layout import OverviewLayout, overview_layout, overview_surface
from s2rtui.plots.overview_model import OverviewModel, overview_model

__all__ = [
    "DifferenceInput",
    "DifferenceModel",
    "DifferenceSummary",
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
    "OverviewLines",
    "OverviewModel",
    "OverviewRow",
    "PoseNumbers",
    "SideView",
    "difference",
    "difference_layout",
    "difference_model",
    "difference_surface",
    "fit",
    "geomap",
    "geomap_layout",
    "geomap_model",
    "geomap_surface",
    "histogram",
    "histogram_model",
    "instance",
    "instance_layout",
    "instance_model",
    "overview",
    "overview_layout",
    "overview_model",
    "overview_surface",
    "panned",
    "sample",
    "zoomed",
]
