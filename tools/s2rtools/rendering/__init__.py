"""Renderers: render a data set's frames again with moved cameras.

Registry: `RENDERERS` lists the `RendererKind`s. To add a renderer, write one module and add one
line to `RENDERERS`.
"""

from __future__ import annotations

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.rendering.frame_renderer import FrameRenderer, RendererKind
from s2rtools.rendering.world_renderer import WORLD

__all__ = ["RENDERERS", "FrameRenderer", "no_renderer_reason", "open_renderer", "renderer_version"]

RENDERERS: tuple[RendererKind, ...] = (WORLD,)


def no_renderer_reason(store: Store) -> str | None:
    """Why a store's cameras cannot be moved; None if a renderer supports the store. Fast."""
    if _find_renderer(store) is not None:
        return None
    return f"{store.path}: its images were taken, not rendered; cameras cannot be moved"


def open_renderer(store: Store, domain: str) -> FrameRenderer:
    """Open the renderer of a store's domain.

    Raises RequestError if no renderer supports the store or renders its frames.
    """
    kind = _find_renderer(store)
    if kind is None:
        raise RequestError(str(no_renderer_reason(store)))
    renderer = kind.open(store)
    if domain not in renderer.domains:
        known = ", ".join(renderer.domains)
        raise RequestError(f"domain {domain!r}: cannot be rendered (only {known})")
    return renderer


def renderer_version(store: Store) -> str:
    """Name and version of a store's renderer, a part of the key of rendered frames."""
    kind = _find_renderer(store)
    return f"{kind.name} {kind.version}" if kind else "none"


def _find_renderer(store: Store) -> RendererKind | None:
    return next((kind for kind in RENDERERS if kind.claims(store)), None)
