"""The stored answers of both directions, the chosen one, and their gains on one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from s2rstore.records import Side
from s2rstore.suggestions import Answer, SuggestReport
from s2rtui.drawing.scale import Interval, non_empty

_MARGIN = 1.0
"""Space for bounds beside the gains, as a share of the range of the gains."""
MARKS = {"suggested": "*", "not evident": "?", "": " "}


@dataclass(frozen=True, slots=True)
class Direction:
    """The side that is changed, and the stored report about it.

    commands: those that register the answers as runs. note: without a report, why there is none
    and the command that computes one.
    """

    side: Side
    aim: str
    report: SuggestReport | None = None
    commands: tuple[str, ...] = ()
    note: str = ""

    @property
    def answers(self) -> tuple[Answer, ...]:
        return self.report.answers if self.report is not None else ()

    def state(self, number: int) -> str:
        """`suggested`, `not evident` or empty: what answer `number` (from 0) is."""
        if self.report is not None and self.report.best == number:
            return "suggested"
        return "" if self.answers[number].evident else "not evident"

    def mark(self, number: int) -> str:
        return MARKS[self.state(number)]


@dataclass(frozen=True, slots=True)
class SuggestionsInput:
    """Both directions of a run; `chosen` counts answers from the first suggested one, modulo."""

    directions: tuple[Direction, ...]
    chosen: int = 0

    @property
    def places(self) -> tuple[tuple[Direction, int], ...]:
        """The answers of all directions: each with its direction and its number from 0."""
        return tuple(
            (direction, number)
            for direction in self.directions
            for number in range(len(direction.answers))
        )

    @property
    def chosen_index(self) -> int | None:
        """The place of the chosen answer in `places`; None without answers."""
        places = self.places
        if not places:
            return None
        states = [direction.state(number) for direction, number in places]
        first = states.index("suggested") if "suggested" in states else 0
        return (first + self.chosen) % len(places)

    @property
    def chosen_answer(self) -> tuple[Direction, int] | None:
        """Direction and number of the chosen answer; None without answers."""
        index = self.chosen_index
        return None if index is None else self.places[index]


def gain_scale(report: SuggestReport) -> Interval:
    """The axis of the gains of a report, in its unit.

    It holds 0, all gains and prices, and the bounds that are not far beyond these.
    """
    gains = [answer.gain for answer in report.answers]
    prices = [len(answer.changes) * report.price_of_a_change for answer in report.answers]
    values = [0.0, *finite(prices), *finite([gain.value for gain in gains])]
    margin = _MARGIN * (max(values) - min(values))
    bounds = finite([bound for gain in gains for bound in (gain.low, gain.high)])
    ends = np.clip([*values, *bounds], min(values) - margin, max(values) + margin)
    return non_empty(float(ends.min()), float(ends.max()))


def evidence_text(report: SuggestReport) -> str:
    """What the answers were judged on, and the price of a change, in one sentence."""
    before = f"mean real error {report.before:.2f} m"
    price = f"{100 * report.price:g} % ({report.price_of_a_change:.2f} m)"
    if report.side == "sim":
        before, price = f"mismatch of the images {report.before:.3g}", f"{100 * report.price:g} %"
    unfinished = "" if report.complete else "; the time was used up before the search ended"
    return (
        f"{before} on {report.judged_instances} held-out instances; fitted on "
        f"{report.fitted_instances} others; price of each change {price}{unfinished}"
    )


def details(direction: Direction, number: int) -> list[str]:
    """Lines about one answer: fitted values with intervals and truth, and the agreement."""
    answer = direction.answers[number]
    lines = []
    for change in answer.changes:
        if change.interval is None:
            continue
        truth = "" if change.truth is None else f", true {change.truth:g}"
        known = change.interval
        bounds = known.bounds_text("{:.3g}".format, to=" .. ")
        lines.append(f"{change.name}={change.value:g} ({bounds}){truth}")
    if lines:
        lines = ["; ".join(lines)]
    made = answer.agreement
    if made is not None:
        lines.append(
            f"sim error {made.sim_error_before:.2f} -> {made.sim_error:.2f} m, real "
            f"{made.real_error:.2f} m; predictions closer by {made.closer.value:.2f} m "
            f"({made.closer.bounds_text(to=' .. ')}); correlation of errors "
            f"{made.correlation_before:.2f} -> {made.correlation:.2f}"
        )
    return lines


def finite(values: Sequence[float]) -> list[float]:
    """The values that are numbers."""
    return [value for value in values if math.isfinite(value)]
