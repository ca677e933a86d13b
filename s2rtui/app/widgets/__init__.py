"""Widgets: they draw ready canvases and fetch nothing."""

from s2rtui.app.widgets.bar import Bar
from s2rtui.app.widgets.plot import PlotView

__all__ = ["Bar", "PlotView"]
