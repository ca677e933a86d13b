"""Going to views, by keys and by letters."""

from __future__ import annotations

from collections.abc import Iterable

from textual.geometry import Region

from s2rtui.app.screens.jump import Target
from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.session import Session, State, display

_STORED = [view.name for view in sorted(VIEWS, key=lambda view: view.key) if view.from_store]


def to(session: Session, name: str, on_screen: bool) -> State:
    """Have keys speak to a view, and see it where it is not on the screen."""
    if on_screen:
        return display.activate(session, name)
    return display.show_view(session, name, BY_NAME[name].pane)


def beside(present: str, steps: int) -> str:
    """The view so many keys further."""
    at = _STORED.index(present) if present in _STORED else 0
    return _STORED[(at + steps) % len(_STORED)]


def targets(regions: Iterable[tuple[str, Region]], status: str, expression: str) -> list[Target]:
    """The views by name and region, and the parts of the status line."""
    found = [Target(region.x, region.y, f"view('{name}')") for name, region in regions]
    for part, action in (("traj ", "do('trajectory')"), ("run ", "do('next_run')"),
                         (expression[:6], "edit")):  # fmt: skip
        column = status.find(part)
        if column >= 0:
            found.append(Target(column + 1, 0, action))
    return found
