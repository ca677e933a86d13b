"""Figures for paper: the inputs of the plots, drawn by matplotlib as PNG bytes."""

from s2rtui.figures.difference import difference_figure
from s2rtui.figures.geomap import geomap_figure
from s2rtui.figures.histogram import histogram_figure
from s2rtui.figures.instance import instance_figure
from s2rtui.figures.orientation import orientation_figure
from s2rtui.figures.overview import overview_figure
from s2rtui.figures.rooms import rooms_figure
from s2rtui.figures.umap import umap_figure

__all__ = [
    "geomap_figure",
    "histogram_figure",
    "instance_figure",
    "orientation_figure",
    "overview_figure",
    "rooms_figure",
    "umap_figure",
]
__all__ = ["difference_figure", "geomap_figure", "instance_figure", "overview_figure"]
