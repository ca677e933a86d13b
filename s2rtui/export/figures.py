"""Figures of views on pages of a chosen size, for `s2r export` and for notebooks."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtui.canvas import DARK, LIGHT, Theme
from s2rtui.charts.registry import STORED, View
from s2rtui.charts.scene import Scene
from s2rtui.drawing.figure_format import (
    FigureFormat,
    FileFormat,
    Form,
    check_colour_map,
    figure_format,
)
from s2rtui.export.load_scene import SceneOptions, open_scene

Pixels = tuple[int, int]
FORMATS: tuple[FileFormat, ...] = get_args(FileFormat)
MM_PER_INCH = 25.4
DEFAULT_DPI = 300
DEFAULT_MM = 160.0
"""Width of a page of which only the resolution is given."""
NARROW_MM = 120.0
"""Reports have figures of one column below this width of pages."""
_MM_RANGE, _DPI_RANGE = (40.0, 420.0), (72, 1200)


@dataclass(frozen=True, slots=True)
class PageOptions:
    """The page of a figure.

    title replaces the title of the view. width: millimetres on paper, where fonts have 8 to 10
    points; dpi: pixels per inch of this width (default 300; without `width` of a page of 160
    mm). size: pixels of a page whose fonts scale with it; by default the size of the view. cmap:
    colour map of continuous values, one of `s2rtui.drawing.figure_format.COLOUR_MAPS`. Raises
    RequestError for values out of range or unknown, and where `size` and a physical size are given.
    """

    title: str | None = None
    dpi: int | None = None
    width: float | None = None
    cmap: str = "turbo"
    size: Pixels | None = None
    dark: bool = False

    def __post_init__(self) -> None:
        check_colour_map(self.cmap)
        for name, value, (low, high) in (
            ("width", self.width, _MM_RANGE), ("dpi", self.dpi, _DPI_RANGE),
        ):  # fmt: skip
            if value is not None and not low <= value <= high:
                raise RequestError(f"--{name} {value:g}: must be {low:g} to {high:g}")
        if self.size is not None and self.is_physical:
            raise RequestError("--size: pixels; leave it out with --width and --dpi")

    @property
    def is_physical(self) -> bool:
        """Whether the page has a size in millimetres."""
        return self.width is not None or self.dpi is not None

    @property
    def millimetres(self) -> float:
        """The width of a page with a physical size."""
        return self.width or DEFAULT_MM

    @property
    def theme(self) -> Theme:
        return DARK if self.dark else LIGHT

    def pixels(self, view: View) -> Pixels:
        """The size of a view's figure in pixels; of height 0 where that of its parts counts."""
        if not self.is_physical:
            return self.size or view.figure_size
        return round(self.millimetres / MM_PER_INCH * (self.dpi or DEFAULT_DPI)), 0

    @contextmanager
    def format(self, form: Form = "png", type_size: float = 1.0) -> Iterator[None]:
        """The context in which figures are drawn for this page."""
        dpi = float(self.dpi or DEFAULT_DPI) if self.is_physical else None
        with figure_format(FigureFormat(form, type_size, dpi, self.title, self.cmap)):
            yield


def draw_figure(scene: Scene, view: View, page: PageOptions, form: FileFormat = "png") -> bytes:
    """The file of a view's figure."""
    with page.format(form):
        return view.figure(scene, page.pixels(view), page.theme)


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of one generation of a store; it is drawn when it is shown or saved."""

    path: Path
    generation: int
    view: str
    scene: SceneOptions
    page: PageOptions

    def encoded(self, form: FileFormat = "png") -> bytes:
        """The file. Raises RequestError where the view has nothing to draw."""
        view = STORED[self.view]
        with open_scene(self.path, self.scene, view, generation=self.generation) as scene:
            return draw_figure(scene, view, self.page, form)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write PNG, SVG or PDF, by the end of the name."""
        file = Path(path)
        file.write_bytes(self.encoded(format_of(file)))

    def _repr_png_(self) -> bytes:
        return self.encoded()

    def __repr__(self) -> str:
        return f"<figure of view {self.view}, {self.scene.select}; save(path) writes it>"


def format_of(path: Path, option: str = "save") -> FileFormat:
    """The file format that the end of a name stands for. Raises RequestError for others."""
    for form in FORMATS:
        if path.suffix == f".{form}":
            return form
    raise RequestError(f"{option} {path}: must end in {', '.join(f'.{form}' for form in FORMATS)}")


def figure(store: Store, view: str, **options: Any) -> Figure:
    """The figure of a view of an open store; options are fields of the scene and of the page.

    Names of `s2r export` hold, too: `trajectory`, `with_run`, `on`, `mode`. Raises RequestError
    for unknown views and options, before anything is drawn.
    """
    if find_spec("matplotlib") is None:
        raise RequestError("figure: needs the package matplotlib; install s2rtui")
    if view not in STORED:
        raise RequestError(f"figure {view}: must be one of {', '.join(STORED)}")
    given = {_ALIASES.get(name, name): value for name, value in options.items()}
    scene_names, page_names = (_names(kind) for kind in (SceneOptions, PageOptions))
    for name in given:
        if name not in (*scene_names, *page_names):
            known = ", ".join(sorted((*scene_names, *page_names)))
            raise RequestError(f"figure: unknown option {name}; known: {known}")
    if isinstance(given.get("trajectories"), str):
        given["trajectories"] = (given["trajectories"],)
    page = PageOptions(**{name: given[name] for name in page_names if name in given})
    scene = SceneOptions(**{name: given[name] for name in scene_names if name in given})
    return Figure(store.path, store.generation, view, scene, page)


_ALIASES = {
    "trajectory": "trajectories", "with_run": "other", "on": "overlay", "mode": "map_mode",
    "value": "map_value",
}  # fmt: skip


def _names(kind: type) -> Sequence[str]:
    return [field.name for field in dataclasses.fields(kind)]
