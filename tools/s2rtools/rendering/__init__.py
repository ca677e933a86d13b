"""Taking a data set's frames anew: `RENDERERS` lists the ways. Adding one is a file and a line."""

from __future__ import annotations

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.rendering.frame_renderer import FrameRenderer, RendererKind
from s2rtools.rendering.world_renderer import WORLD

__all__ = ["RENDERERS", "FrameRenderer", "no_renderer_reason", "open_renderer", "renderer_version"]

RENDERERS: tuple[RendererKind, ...] = (WORLD,)


def no_renderer_reason(store: Store) -> str | None:
    """Why the cameras of a store cannot be moved; None where a renderer claims it. Quick."""
    if _find_renderer(store) is not None:
        return None
    return f"{store.path}: images taken, not rendered: no camera to move"


def open_renderer(store: Store, domain: str) -> FrameRenderer:
    """The renderer of a store's domain.

    Raises RequestError where there is none, or none that renders what the store holds.
    """
    kind = _find_renderer(store)
    if kind is None:
        raise RequestError(str(no_renderer_reason(store)))
    found = kind.open(store)
    if domain not in found.domains:
        known = ", ".join(found.domains)
        raise RequestError(f"domain {domain!r}: cannot be rendered (only {known})")
    return found


def renderer_version(store: Store) -> str:
    """Names what renders a store: frames of another version are other frames."""
    kind = _find_renderer(store)
    return f"{kind.name} {kind.version}" if kind else "none"


def _find_renderer(store: Store) -> RendererKind | None:
    return next((kind for kind in RENDERERS if kind.claims(store)), None)
