"""The registry of views: adding a view means adding the name of its folder to `NAMES`."""

from importlib import import_module

from s2rtui.charts.risk.view import RISK
from s2rtui.charts.scene import Resources, Scene
from s2rtui.charts.view import View

NAMES = (
    "overview",
    "map",
    "instance",
    "umap",
    "orientation",
    "rooms",
    "errors",
    "scatter",
    "shares",
    "recall",
    "list",
    "compare",
    "history",
    "findings",
    "suggestions",
    "adjust",
)
"""Folders of `s2rtui.charts`, in the order in which views are listed."""


def _view(name: str) -> View:
    """The view of a folder. Raises TypeError where its `VIEW` is missing or misnamed."""
    view = getattr(import_module(f"s2rtui.charts.{name}.view"), "VIEW", None)
    if not isinstance(view, View) or view.name != name:
        raise TypeError(f"s2rtui.charts.{name}.view: VIEW must be a View named {name!r}")
    return view


VIEWS: tuple[View, ...] = tuple(_view(name) for name in NAMES)
BY_NAME = {view.name: view for view in VIEWS}
STORED = {word: view for view in VIEWS if view.from_store for word in (view.name, *view.aliases)}
"""Views that a store alone can fill, by name and alias."""
PRINTED: dict[str, View] = {**STORED, RISK.name: RISK}
"""What `s2r show` prints: the views of a store, and tables that have no view."""

__all__ = ["BY_NAME", "NAMES", "PRINTED", "STORED", "VIEWS", "Resources", "Scene", "View"]
