"""The registry of views: adding a view means adding the name of its module to `NAMES`.

Installed packages add views by entry points of the group `s2r.views`, which name a `View`.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.plugins import Registry
from s2rtui.charts.scene import LoadedData, Scene
from s2rtui.charts.view import View

NAMES = (
    "overview",
    "map",
    "instance",
    "umap",
    "orientation",
    "rooms",
    "pivot",
    "errors",
    "scatter",
    "shares",
    "objects",
    "recall",
    "risk",
    "exchange",
    "timeline",
    "drives",
    "list",
    "sheet",
    "compare",
    "history",
    "health",
    "findings",
    "suggestions",
    "adjust",
)
"""Modules of `s2rtui.charts`, in the order in which views are listed."""
_NEEDED = ("name", "key", "description")


def _view(name: str) -> View:
    """The view of a module. Raises TypeError where its `VIEW` is missing or misnamed."""
    module = import_module(f"s2rtui.charts.{name}")
    view = getattr(module, "VIEW", None)
    if not isinstance(view, View) or view.name != name:
        raise TypeError(f"{module.__name__}: VIEW must be a View named {name!r}")
    return view


def _check(name: str, view: Any, others: Mapping[str, View | str]) -> View:
    """A view of an installed package. Raises RequestError for one that cannot be used."""
    if not isinstance(view, View):
        raise RequestError("is no s2rtui.charts.view.View")
    if missing := [name for name in _NEEDED if not isinstance(getattr(view, name, None), str)]:
        raise RequestError(f"has no {' and no '.join(missing)}")
    words = {word for each in others.values() if isinstance(each, View)
             for word in (each.name, each.key, *each.aliases)}  # fmt: skip
    if taken := words & {view.name, view.key, *view.aliases}:
        raise RequestError(f"{min(taken)!r} is taken")
    return view


REGISTRY = Registry[View]("view", {name: _view(name) for name in NAMES}, _check)
VIEWS: tuple[View, ...] = tuple(REGISTRY.values())
BY_NAME = {view.name: view for view in VIEWS}
STORED = {word: view for view in VIEWS if view.from_store for word in (view.name, *view.aliases)}
"""Views that a store alone can fill, by name and alias."""

__all__ = ["BY_NAME", "NAMES", "STORED", "VIEWS", "LoadedData", "Scene", "View"]
