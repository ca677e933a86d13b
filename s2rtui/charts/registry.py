"""The registry of views: adding a view means adding the name of its module to `NAMES`.

Installed packages add views by entry points of the group `s2r.views`, which name a `View`.
"""

from importlib import import_module
from importlib.metadata import entry_points

from s2rstore.errors import RequestError, first_line
from s2rstore.security.printable_text import printable
from s2rtui.charts.scene import LoadedData, Scene
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
    "objects",
    "recall",
    "risk",
    "exchange",
    "timeline",
    "list",
    "compare",
    "history",
    "findings",
    "suggestions",
    "adjust",
)
"""Modules or folders of `s2rtui.charts`, in the order in which views are listed."""
ENTRY_POINTS = "s2r.views"
_NEEDED = ("name", "key", "description")


def _view(name: str) -> View:
    """The view of a module or folder. Raises TypeError where its `VIEW` is missing or misnamed."""
    module = import_module(f"s2rtui.charts.{name}")
    if not hasattr(module, "VIEW"):
        module = import_module(f"s2rtui.charts.{name}.view")
    view = getattr(module, "VIEW", None)
    if not isinstance(view, View) or view.name != name:
        raise TypeError(f"{module.__name__}: VIEW must be a View named {name!r}")
    return view


def _added(known: tuple[View, ...]) -> tuple[View, ...]:
    """The views of installed packages, by name. Raises RequestError for one that cannot be used."""
    names = {word for view in known for word in (view.name, *view.aliases)}
    keys = {view.key for view in known}
    added: list[View] = []
    for entry in sorted(entry_points(group=ENTRY_POINTS), key=lambda each: each.name):
        what = f"view {entry.name}: {entry.value}"
        try:
            view = entry.load()
        except Exception as error:  # code of others may raise anything
            message = f"{what} cannot be loaded: {printable(first_line(error))}"
            raise RequestError(message) from error
        if not isinstance(view, View):
            raise RequestError(f"{what} is no s2rtui.charts.view.View")
        if missing := [name for name in _NEEDED if not isinstance(getattr(view, name, None), str)]:
            raise RequestError(f"{what} has no {' and no '.join(missing)}")
        if taken := names & {view.name, *view.aliases} or keys & {view.key}:
            raise RequestError(f"{what}: {taken.pop()!r} is taken")
        names |= {view.name, *view.aliases}
        keys.add(view.key)
        added.append(view)
    return tuple(added)


_OWN = tuple(_view(name) for name in NAMES)
VIEWS: tuple[View, ...] = (*_OWN, *_added(_OWN))
BY_NAME = {view.name: view for view in VIEWS}
STORED = {word: view for view in VIEWS if view.from_store for word in (view.name, *view.aliases)}
"""Views that a store alone can fill, by name and alias."""

__all__ = ["BY_NAME", "ENTRY_POINTS", "NAMES", "STORED", "VIEWS", "LoadedData", "Scene", "View"]
