"""Figures for paper: the inputs of the plots, drawn by matplotlib as the bytes of a file."""

from s2rtui.charts.compare.paper import compare_figure
from s2rtui.charts.compare.paper_difference import difference_figure
from s2rtui.charts.errors.paper import histogram_figure
from s2rtui.charts.history.paper import history_figure
from s2rtui.charts.instance.paper import instance_figure
from s2rtui.charts.map.paper import geomap_figure
from s2rtui.charts.orientation.paper import orientation_figure
from s2rtui.charts.overview.paper import overview_figure
from s2rtui.charts.rooms.paper import rooms_figure
from s2rtui.charts.shared.paper import Form, written_as
from s2rtui.charts.table.paper import table_figure
from s2rtui.charts.umap.paper import umap_figure

__all__ = [
    "Form",
    "compare_figure",
    "difference_figure",
    "geomap_figure",
    "histogram_figure",
    "history_figure",
    "instance_figure",
    "orientation_figure",
    "overview_figure",
    "rooms_figure",
    "table_figure",
    "umap_figure",
    "written_as",
]
