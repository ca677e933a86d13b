"""Figures for paper: the inputs of the plots, drawn by matplotlib as the bytes of a file."""

from s2rtui.figures.compare import compare_figure
from s2rtui.figures.difference import difference_figure
from s2rtui.figures.geomap import geomap_figure
from s2rtui.figures.histogram import histogram_figure
from s2rtui.figures.history import history_figure
from s2rtui.figures.instance import instance_figure
from s2rtui.figures.orientation import orientation_figure
from s2rtui.figures.overview import overview_figure
from s2rtui.figures.rooms import rooms_figure
from s2rtui.figures.style import Form, written_as
from s2rtui.figures.table import table_figure
from s2rtui.figures.umap import umap_figure

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
