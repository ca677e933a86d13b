"""The heatmaps of a run, and their projection on the map."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import NotComputedError
from s2rstore.geometry.floor_grid import FloorHeat, Ray
from s2rstore.geometry.map_grid import AGGREGATES, MapGrid
from s2rstore.heatmap_kinds import HEATMAPS, NO_HEAT, heatmap_facts
from s2rstore.metrics import heatmap_scores
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SIDES, Run, Side
from s2rstore.run_inputs import run_domain, run_frames
from s2rtui.session.state import Aggregate, HeatChoice, State

SIGNED = frozenset(kind for kind, facts in HEATMAPS.items() if facts.is_signed)
_ORDER: dict[Side, tuple[Side, Side]] = {"sim": ("sim", "real"), "real": ("real", "sim")}
_UNITS = {"m degrees": "m", "m m rad loss": "", "activation": "arb. units"}
"""Units of shown values by the units of stored arrays. Distances of a network's features have no
physical unit; `activation` would be mistaken for the heatmap kind of this name."""
_BLOCK = 32
MAX_GATHERED = 2000
"""Heat of a larger selection is aggregated over this many instances, evenly spaced."""
ReportShare = Callable[[float], bool]


def heatmap_choices(store: Store, run: str) -> list[tuple[str, str | None]]:
    """Kinds and modes of a run's heatmaps: the most trusted kind for what has changed, those that
    say what it costs, then the others from the most to the least trusted.
    """
    choices: list[tuple[str, str | None]] = []
    for record in store.array_kinds(run) if run != NO_RUN else ():
        if "row" not in record.axes or record.kind.startswith(("map:", "frames:")):
            continue
        for mode in heatmap_facts(record.kind).modes or (record.mode,):
            if (record.kind, mode) not in choices:
                choices.append((record.kind, mode))
    ranked = heatmap_scores.ranked(store, run, choices)

    def place(choice: tuple[str, str | None]) -> tuple[int, bool]:
        kind, mode = choice
        facts = heatmap_facts(kind)
        if kind == ranked[0][0] or facts.harm_auroc is None:
            return (0 if kind == ranked[0][0] else 2), False
        return 1, mode != facts.default_mode

    return sorted(ranked, key=place)


def with_heat(store: Store, state: State) -> State:
    """The state with its heatmap choice if the run has it, else the run's most trusted one."""
    options = heatmap_choices(store, state.run)
    side: Side = state.heat.side if state.heat else "real"
    previous = (state.heat.kind, state.heat.mode) if state.heat else None
    if not options:
        return replace(state, heat=None)
    if state.heat is not None and state.heat.kind == NO_HEAT:
        return state
    kind, mode = previous if previous in options else options[0]
    return replace(state, heat=HeatChoice(kind, mode, side))


def trust_text(store: Store, state: State) -> str:
    """What the shown heatmap means and how far it can be trusted; empty without one."""
    heat = state.shown_heat
    return heatmap_scores.trust_line(store, state.run, heat.kind, heat.mode) if heat else ""


def unit(store: Store, run: str, heat: HeatChoice) -> str:
    """The unit of the shown values."""
    facts = heatmap_facts(heat.kind)
    if facts.planes:
        return facts.planes[heat.mode or facts.modes[0]]
    choice = heat.kind, heat.mode
    record = next((r for r in store.array_kinds(run) if (r.kind, r.mode) == choice), None)
    return _UNITS.get(record.unit, record.unit) if record else ""


def run_range(store: Store, run: str, heat: HeatChoice) -> tuple[float, float] | None:
    """The run's 1st .. 99th percentile of a heatmap kind; None if it was not recorded."""
    recorded = store.provenance_object(f"run:{run}", "heat ranges")
    percentiles = recorded.get(":".join(part for part in (heat.kind, heat.mode) if part))
    if not isinstance(percentiles, list) or len(percentiles) != 2:
        return None
    if not all(isinstance(value, int | float) for value in percentiles):
        return None
    return float(percentiles[0]), float(percentiles[1])


def ray_of(heat: HeatChoice) -> Ray:
    """The camera whose pixels a heatmap lies on."""
    return "depth" if heat.mode == "depth" else "rgb"


def run_grid(
    store: Store, run: str, heat: HeatChoice, aggregate: str = "mean"
) -> NDArray[np.float32] | None:
    """A published map grid of a run, NaN for empty cells; None if it was not computed."""
    try:
        grid = store.map_grid(run, heat.kind, heat.side, heat.mode, aggregate)
    except NotComputedError:
        return None
    return without_blanks(grid, heat, aggregate)


def without_blanks(
    cells: NDArray[np.float32], heat: HeatChoice, aggregate: str
) -> NDArray[np.float32]:
    """The cells with NaN for those without samples, and for those where signed heat is 0."""
    is_blank = cells == 0 if aggregate == "count" or heat.kind in SIGNED else np.isnan(cells)
    return np.where(is_blank, np.nan, cells).astype(np.float32)


def instance_grid(store: Store, run: str, heat: HeatChoice, iid: int) -> NDArray[np.float32]:
    """The mean grid of one instance's heatmap, (rows, cols), NaN for empty cells."""
    return selection_grid(store, run, heat, np.array([iid]), "mean")


def require_floor(store: Store, run: str, heat: HeatChoice) -> None:
    """Raise RequestError unless the domains that the heat is projected with have depth."""
    surfaces = store.provenance_object(f"run:{run}", "surfaces")
    sides = SIDES if heat.kind in surfaces else (heat.side,)
    store.require_depth(map(store.run(run).domain, sides), "heat on the map")


def selection_grid(
    store: Store,
    run: str,
    heat: HeatChoice,
    iids: NDArray[np.intp],
    aggregate: Aggregate,
    report_share: ReportShare = lambda share: True,
) -> NDArray[np.float32]:
    """Project heatmaps of some instances on the floor: (rows, cols), NaN for empty cells.

    An empty kind projects every pixel without a heatmap. `report_share` gets the share that is done
    and returns False to stop.
    """
    require_floor(store, run, heat)
    record = store.run(run)
    grid = MapGrid(store.dataset.bounds)
    for chosen, block in _blocks(store, iids):
        if not heat.kind:
            values = np.zeros((len(chosen), 1, 1), dtype=np.float32)
        else:
            span = block.start, block.stop
            values = store.heatmaps(run, heat.kind, heat.side, *span, heat.mode)[chosen]
        _project(store, record, heat, values, chosen, block, grid)
        if not report_share(float(np.searchsorted(iids, block.stop)) / iids.size):
            break
    cells = np.asarray(grid.aggregates()[AGGREGATES.index(aggregate)])
    return without_blanks(cells, heat, aggregate)


def sample_note(state: State) -> str:
    """` (2000 of 5301 instances)` if the selection is larger than `MAX_GATHERED`; else empty."""
    count = int(np.count_nonzero(state.selected))
    return f" ({MAX_GATHERED} of {count} instances)" if count > MAX_GATHERED else ""


def visible_floor(
    store: Store,
    run: str,
    side: Side,
    iids: NDArray[np.intp],
    report_share: ReportShare = lambda share: True,
) -> NDArray[np.float32]:
    """How often the frames of some instances saw each cell of the floor, NaN for never."""
    heat = HeatChoice("", "depth", side)
    return selection_grid(store, run, heat, iids, "count", report_share).astype(np.float32)


def _blocks(store: Store, iids: NDArray[np.intp]) -> Iterator[tuple[NDArray[np.intp], slice]]:
    """Group neighbouring iids: offsets into a span of at most `_BLOCK` instances.

    A span does not go beyond a part of a trajectory, because the run may lack the next one.
    """
    firsts = [part.first_iid for part in store.trajectory_parts]
    part = np.searchsorted(firsts, iids, side="right")
    starts = np.flatnonzero(np.diff(iids // _BLOCK, prepend=-1) | np.diff(part, prepend=-1))
    for part in np.split(iids, starts[1:]):
        if part.size:
            yield part - part[0], slice(int(part[0]), int(part[-1]) + 1)


def _project(
    store: Store,
    run: Run,
    heat: HeatChoice,
    values: NDArray[np.float32],
    chosen: NDArray[np.intp],
    block: slice,
    grid: MapGrid,
) -> None:
    """Add the heat of the chosen instances of a block to the grid, as precompute does."""
    domain, other = (run_domain(store, run, side) for side in _ORDER[heat.side])
    recorded = store.provenance_object(f"run:{run.run}", "surfaces")
    rig_offset, ray = store.rig_offset(run.sim_domain, run.real_domain), ray_of(heat)
    floor_heat = FloorHeat(
        domain, other, store.dataset, heat.side, rig_offset, recorded.get(heat.kind), ray
    )

    def depth(side: Side) -> NDArray[Any]:
        read = run_frames(store, run, side, block.start, block.stop, ("depth",))
        return np.asarray(read["depth"][chosen])

    near, far = _ORDER[heat.side]
    poses = store.poses(run.domain(near))[block][chosen]
    other_depth = depth(far) if floor_heat.needs_other else None
    samples = floor_heat.samples(depth(near), other_depth, poses, grid)
    grid.add(*samples.values(values, ray))
