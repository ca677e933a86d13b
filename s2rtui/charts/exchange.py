"""The exchange view: what real images tell about the runs, and what simulation adds to them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from s2rstore.language.canonical_text import string
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.charts.view import StatisticsView
from s2rtui.drawing.figures import Figure, Figures
from s2rtui.drawing.plot import Dots, Line, Mark, Plot
from s2rtui.drawing.scale import Scale, non_empty
from s2rtui.drawing.table import Cell, Column, Dot, Row, Span, StripMark, TableSpec
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rstore.intervals.simulation import WithSimulation
    from s2rstore.metrics.evaluation import RoomFigure

_FEWEST, _MOST = 0.25, 16.0
"""Factors of the present number of images at the ends of the curve."""
_SAMPLES = 200


@dataclass(frozen=True, slots=True)
class ExchangeModel:
    """The mean error of each computed run in metres, real images alone and with simulation.

    rooms: those of `run` that have enough pairs for an exchange rate.
    """

    run: str
    means: Mapping[str, WithSimulation]
    rooms: tuple[RoomFigure, ...] = ()


class ExchangeView(StatisticsView):
    name = "exchange"
    key = "$"
    description = "exchange rate: what simulated images add to real ones"
    about = "mean real errors, and real images that simulation saves"
    title = "what simulated images are worth"

    def model(self, store: Store, state: State) -> ExchangeModel | str:
        from s2rstore.metrics.evaluation import images_of, room_figures
        from s2rstore.metrics.exchange import mean_errors

        members = self.members(state)
        means = mean_errors(store, members)
        if not means:
            return "no selected instance is new to a run"
        rooms: tuple[RoomFigure, ...] = ()
        if state.run in means:
            found = room_figures(store, state.run, images_of(store, [state.run], members))
            rooms = tuple(room for room in found if room.rate.is_known)
        return ExchangeModel(state.run, means, rooms)

    def figures(self, model: ExchangeModel) -> Figures:
        of_rooms = [
            Figure("exchange rate", each.rate, digits=1, of=f"{model.run}, {each.room}", n=each.n)
            for each in model.rooms
        ]
        of_runs = (each for run, mean in model.means.items() for each in _figures(run, mean))
        return {"real": [*of_runs, *of_rooms]}

    def plots(self, model: ExchangeModel) -> tuple[Plot, ...]:
        mean = model.means.get(model.run)
        return (_plot(mean),) if mean is not None and math.isfinite(_half(mean)) else ()

    def table(self, model: ExchangeModel) -> TableSpec:
        with_simulation = any(mean.simulated for mean in model.means.values())
        combined = (Column("with simulation", "both", rank=2),) if with_simulation else ()
        columns = (
            Column("run"), Column("", scale=_scale(model), least=17), Column("real", "real"),
            *combined, Column("rate"), Column("correlation", rank=1),
            Column("n", right=True, rank=3),
        )  # fmt: skip
        rows = (_row(run, mean, run == model.run, with_simulation)
                for run, mean in model.means.items())  # fmt: skip
        return TableSpec(columns, tuple(rows))

    def choices(self, model: ExchangeModel, side: Side) -> Sequence[tuple[str, str]]:
        """Runs with their real images: the pairs that are new to each."""
        runs = {run: "" if run == model.run else f"run({string(run)})." for run in model.means}
        return [(run, f"{prefix}paired & {prefix}new") for run, prefix in runs.items()]

    def notes(self, model: ExchangeModel) -> tuple[str, ...]:
        from s2rstore.intervals.simulation import MIN_PAIRS

        chosen = model.means.get(model.run) or next(iter(model.means.values()))
        further = (
            f"{chosen.simulated:,} further simulated images"
            if chosen.simulated
            else ("no further simulated images")
        )
        rooms = ", ".join(
            f"{room.room} {room.rate.with_bounds('{:.1f}'.format)}" for room in model.rooms
        )
        few = [run for run, mean in model.means.items() if mean.n < MIN_PAIRS]
        return (
            f"{chosen.n} real images; {further}; metres, with 95 % intervals",
            "rate: what a real image is worth beside unlimited simulated ones, as in the curve",
            *([f"rate of {model.run} by room: {rooms}"] if rooms else []),
            *([f"fewer than {MIN_PAIRS} pairs: {', '.join(few)}"] if few else []),
        )  # fmt: skip


def _half(mean: WithSimulation) -> float:
    """Half the width of the interval of the real images alone, NaN where it has none."""
    return (mean.real_only.high - mean.real_only.low) / 2


def _scale(model: ExchangeModel) -> Scale:
    ends = [end for mean in model.means.values() for each in (mean.real_only, mean.combined)
            for end in (each.value, *map(float, each.bounds)) if math.isfinite(end)]  # fmt: skip
    low, high = non_empty(min(ends, default=0.0), max(ends, default=1.0))
    margin = 0.05 * (high - low)
    return Scale(low - margin, high + margin, ("mean real error (m)", "error (m)", "(m)"))


def _row(run: str, mean: WithSimulation, bold: bool, with_simulation: bool) -> Row:
    strip: list[StripMark] = [
        Span(mean.real_only.low, mean.real_only.high, "real"),
        Dot(mean.real_only.value, "real", "real"),
    ]
    if mean.simulated and mean.combined.is_known:
        strip += [Span(mean.combined.low, mean.combined.high, "both", is_thick=True),
                  Dot(mean.combined.value, "both", "both")]  # fmt: skip
    alone, combined, rate, correlation = (each.cell for each in _figures(run, mean))
    shown = (combined if mean.simulated else Cell("-"),) if with_simulation else ()
    cells = (Cell(run), Cell(strip=tuple(strip)), alone, *shown, rate, correlation,
             Cell(f"{mean.n}"))  # fmt: skip
    return Row(cells, bold=bold)


def _figures(run: str, mean: WithSimulation) -> Iterator[Figure]:
    yield Figure("mean error", mean.real_only, "m", of=run, n=mean.n)
    yield Figure("mean error with simulation", mean.combined, "m", of=run, n=mean.n)
    yield Figure("exchange rate", mean.rate, digits=1, of=run, n=mean.n)
    yield Figure("correlation", mean.correlation, of=run, n=mean.n)


def _plot(mean: WithSimulation) -> Plot:
    """Half the width of the interval against the number of real images."""
    from s2rstore.metrics.more_images import half_width

    factors = np.geomspace(_FEWEST, _MOST, _SAMPLES)
    images = factors * mean.n
    alone = np.array([half_width(mean.real_only, factor) for factor in factors])
    marks: list[Mark] = [Line(images, alone, "real", "real alone")]
    if mean.rate.is_known and math.isfinite(mean.rate.value):
        rate = mean.rate.value
        halves = [half_width(mean.real_only, factor, rate) for factor in factors]
        marks.append(Line(images, np.array(halves), "both", "with simulation"))
    marks.append(Dots(np.array([float(mean.n)]), np.array([_half(mean)]), "real", name="today"))
    x = Scale(images[0], images[-1], ("number of real images", "real images"), log=True)
    y = Scale(
        0, 1.05 * float(alone.max()), ("half width of the interval (m)", "half width (m)", "m")
    )
    return Plot(x, y, tuple(marks))


VIEW = ExchangeView()
