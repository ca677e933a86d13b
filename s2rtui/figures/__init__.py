"""Figures for paper: the inputs of the plots, drawn by matplotlib as PNG bytes."""

from s2rtui.figures.difference import difference_figure
from s2rtui.figures.geomap import geomap_figure
from s2rtui.figures.instance import instance_figure
from s2rtui.figures.overview import overview_figure

__all__ = ["difference_figure", "geomap_figure", "instance_figure", "overview_figure"]
