"""Every view once; a new one is a file here and a line in `VIEWS`."""

from s2rtui.views.adjust import AdjustView
from s2rtui.views.compare import CompareView
from s2rtui.views.contract import Resources, Scene, View
from s2rtui.views.errors import ErrorsView
from s2rtui.views.geomap import MapView
from s2rtui.views.history import HistoryView
from s2rtui.views.instance import InstanceView
from s2rtui.views.orientation import OrientationView
from s2rtui.views.overview import OverviewView
from s2rtui.views.rooms import RoomsView
from s2rtui.views.table import ListView
from s2rtui.views.umap import UmapView

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
