"""The compared run, and how the domains and cameras of two runs differ."""

from __future__ import annotations

import math

from s2rstore.geometry.camera_offset import hfov
from s2rstore.reader import Store
from s2rstore.records import SIDES, Domain
from s2rstore.run_inputs import run_domain
from s2rtui.session.state import State


def other_run(state: State) -> str | None:
    """The run to compare with: the chosen one, else the one after the present run."""
    if state.compared_run is not None and state.compared_run != state.run:
        return state.compared_run
    others = [name for name in state.runs if name != state.run]
    after = [name for name in others if state.runs.index(name) > state.runs.index(state.run)]
    return next(iter(after or others), None)


def runs_in_use(state: State) -> frozenset[str]:
    """The runs whose columns are drawn now or once loading completes."""
    pending = state.pending.run if state.pending else None
    compared = other_run(state) if state.centre == "compare" else None
    return frozenset(run for run in (state.run, pending, compared) if run is not None)


def differences(store: Store, first: str, second: str) -> list[str]:
    """Describe, one line per side, which domains and cameras differ between two runs."""
    lines = []
    for side in SIDES:
        one, two = (run_domain(store, store.run(run), side) for run in (first, second))
        same = "same cameras" if one.domain != two.domain else ""
        difference = _cameras(one, two, store.dataset.frame_width) or same
        if difference:
            lines.append(f"{side}: {one.domain} and {two.domain}: {difference}")
    return lines


def _cameras(one: Domain, two: Domain, width: int) -> str:
    """The camera differences of two domains in degrees and metres; empty if there are none."""
    figures = [
        ("field of view", hfov(one.rgb, width), hfov(two.rgb, width), "deg"),
        ("pitch", math.degrees(one.rgb.pitch), math.degrees(two.rgb.pitch), "deg"),
        ("depth field of view", hfov(one.depth, width), hfov(two.depth, width), "deg"),
        ("height", one.camera_height, two.camera_height, "m"),
    ]
    differing = [
        f"{name} {a:.2f} and {b:.2f} {unit}" for name, a, b, unit in figures if abs(a - b) > 5e-3
    ]
    return f"the cameras differ: {', '.join(differing)}" if differing else ""
