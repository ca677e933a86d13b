"""Every view once; a new one is a file here and a line in `VIEWS`."""

from s2rtui.charts.adjust.view import AdjustView
from s2rtui.charts.compare.view import CompareView
from s2rtui.charts.errors.view import ErrorsView
from s2rtui.charts.history.view import HistoryView
from s2rtui.charts.instance.view import InstanceView
from s2rtui.charts.list.view import ListView
from s2rtui.charts.map.view import MapView
from s2rtui.charts.orientation.view import OrientationView
from s2rtui.charts.overview.view import OverviewView
from s2rtui.charts.rooms.view import RoomsView
from s2rtui.charts.scene import Resources, Scene
from s2rtui.charts.umap.view import UmapView
from s2rtui.charts.view import View

VIEWS: tuple[View, ...] = (
    OverviewView(),
    MapView(),
    InstanceView(),
    UmapView(),
    OrientationView(),
    RoomsView(),
    ErrorsView(),
    ListView(),
    CompareView(),
    HistoryView(),
    AdjustView(),
)
BY_NAME = {view.name: view for view in VIEWS}
STORED = {word: view for view in VIEWS if view.stored for word in (view.name, *view.aliases)}
"""The views that need nothing but a store, by all their words."""

__all__ = ["BY_NAME", "STORED", "VIEWS", "Resources", "Scene", "View"]
