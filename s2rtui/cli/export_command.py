"""`s2r export`: a figure drawn for paper, from the same numbers as the screen."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from s2rtui.canvas import Theme
    from s2rtui.session import Session

    Pixels = tuple[int, int]

_SIZES = {
    "overview": (1600, 900), "geomap": (1600, 1200), "instance": (1600, 1300),
    "workbench": (2000, 1200),
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--view", required=True, choices=tuple(_SIZES))
    parser.add_argument("--out", type=Path, required=True, help="F.png")
    parser.add_argument("--select", default="all", metavar="EXPR", help="an expression")
    parser.add_argument("--run", help="the run (default: the first)")
    parser.add_argument("--iid", type=int, help="the instance (default: the selection's worst)")
    parser.add_argument("--size", help="pixels, for example 1600x1200")
    parser.add_argument("--mode", choices=("colour", "full"), default="colour", help="of the map")
    parser.add_argument("--heat", metavar="KIND[:MODE]", help="heat on the map or the pictures")
    parser.add_argument("--side", choices=("sim", "real"), default="real", help="whose heat")
    parser.add_argument(
        "--aggregate", choices=("mean", "max", "sum", "count"), default="mean",
        help="of the heat on the map; count = pixels that fell on each cell",
    )  # fmt: skip
    parser.add_argument("--dark", action="store_true", help="dark background")


def execute(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from s2rstore.errors import RequestError
    from s2rtui.canvas import DARK, LIGHT
    from s2rtui.session import HeatChoice, Session
    from s2rtui.session.heat import choices

    if options.out.suffix != ".png":
        raise RequestError(f"--out {options.out}: must end in .png")
    size = _size(options.size) or _SIZES[options.view]
    session = Session(options.store, options.run)
    try:
        session.select(options.select)
        state = session.state
        if options.heat is not None:
            kind, _, mode = options.heat.partition(":")
            known = choices(session.store, state.run)
            found = [pair for pair in known if pair[0] == kind and (not mode or pair[1] == mode)]
            if not found:
                listed = ", ".join(f"{k}:{m}" if m else k for k, m in known) or "none"
                raise RequestError(f"--heat {options.heat}: run {state.run} has {listed}")
            state = replace(state, heat=HeatChoice(*found[0], options.side), overlay="run")
        if options.iid is not None:
            if not 0 <= options.iid < state.base.size:
                raise RequestError(f"--iid {options.iid}: 0 .. {state.base.size - 1}")
            state = replace(state, cursor=options.iid)
        session.state = replace(state, map_mode=options.mode)
        theme = DARK if options.dark else LIGHT
        picture = _picture(session, options.view, size, theme, options.aggregate)
    finally:
        session.close()
    try:
        options.out.write_bytes(picture)
    except OSError as error:
        raise RequestError(f"{options.out}: cannot be written ({error.strerror})") from error
    return 0


def _size(text: str | None) -> Pixels | None:
    from s2rstore.errors import RequestError

    if text is None:
        return None
    found = re.fullmatch(r"(\d{3,5})x(\d{3,5})", text)
    if not found or not all(200 <= int(part) <= 8000 for part in found.groups()):
        raise RequestError(f"--size {text}: pixels from 200x200 to 8000x8000")
    return int(found[1]), int(found[2])


def _picture(session: Session, view: str, size: Pixels, theme: Theme, aggregate: str) -> bytes:
    from dataclasses import replace

    from s2rstore.errors import RequestError
    from s2rtui import figures
    from s2rtui.session import derive, heat

    store, state = session.store, session.state
    if view == "overview":
        rows, baseline = derive.overview_rows(store)
        return figures.overview_figure(rows, baseline, size, theme, state.runs.index(state.run))
    if view == "geomap":
        path = store.floor_plan_path()
        plan = derive.floor_plan(str(path)) if path else None
        grid = None
        if state.overlay == "run" and state.heat is not None:
            grid = heat.run_grid(store, state.run, state.heat, aggregate)
        shown = derive.map_input(store, state, plan, grid)
        if grid is not None and aggregate != "mean":
            unit = "pixels" if aggregate == "count" else shown.heat_unit
            label = f"{shown.heat_label}, {aggregate}"
            shown = replace(shown, heat_label=label, heat_unit=unit)
        return figures.geomap_figure(shown, size, theme, state.run, state.expression)
    if view == "instance":
        if state.cursor is None:
            raise RequestError("--select: selects nothing, so there is no instance to draw")
        found = derive.instance_input(store, state.run, state.cursor, state.heat)
        return figures.instance_figure(found, size, theme)
    return _workbench(session, size, theme)


def _workbench(session: Session, size: Pixels, theme: Theme) -> bytes:
    """The application's screen, in cells of 10 x 20 pixels."""
    from s2rtui.canvas import Look
    from s2rtui.headless import screen_of

    look = Look(theme)
    return screen_of(session.store.path, session.state, (size[0] // 10, size[1] // 20), look)
