"""The text lines of the suggestions view, shortened to the size of the view.

The chosen answer is always among them.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Literal

from s2rtui.charts.suggestions.model import (
    Direction,
    SuggestionsInput,
    details,
    evidence_text,
)

Style = Literal["heading", "bold", "plain", "muted"]
BESIDE = 64
"""Columns from which gains are drawn beside the answers."""
_HEAD = 45
"""Width of the text of an answer in columns, left of its drawing."""


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the view.

    index: place of the answer that it belongs to. drawn: its direction, and the number of the
    answer whose gain is drawn in this line from column `start` on, -1 for the axis.
    """

    text: str
    style: Style = "plain"
    index: int | None = None
    direction: Direction | None = None
    drawn: int | None = None
    start: int = 0


ChosenLines = Literal["all", "command", "action", "none"]


@dataclass(frozen=True, slots=True)
class _Extent:
    """What is shown: values of all answers or of the chosen one, and further texts.

    chosen: lines about the chosen answer: all of them, how it is applied with its command or
    without, or none.
    """

    all_values: bool
    evidence: bool
    chosen: ChosenLines


_EXTENTS = (
    _Extent(True, True, "all"),
    _Extent(False, True, "all"),
    _Extent(False, False, "all"),
    _Extent(False, False, "command"),
    _Extent(False, False, "action"),
    _Extent(False, False, "none"),
)


def suggestion_lines(data: SuggestionsInput, width: int, height: int, legend: str) -> list[Line]:
    """The lines for `width` x `height` cells, the most detailed ones that fit."""
    made: list[Line] = []
    for extent in _EXTENTS:
        made = _lines(data, width, extent, legend)
        if len(made) <= height:
            break
    return made


def _lines(data: SuggestionsInput, width: int, extent: _Extent, legend: str) -> list[Line]:
    lines: list[Line] = []
    first = 0
    for direction in data.directions:
        if lines and extent.all_values:
            lines.append(Line(""))
        lines += _wrapped(direction.aim, width, "heading", direction)
        lines += _direction(direction, first, data.chosen_index, width, extent)
        first += len(direction.answers)
    chosen = data.chosen_answer
    if chosen is not None:
        if extent.evidence:
            lines += _wrapped(legend, width, "muted")
        if extent.chosen != "none":
            lines += [Line(""), *_details(*chosen, width, extent.chosen)]
    return lines


def _direction(
    direction: Direction, first: int, chosen: int | None, width: int, extent: _Extent
) -> list[Line]:
    report = direction.report
    if report is None:
        return _wrapped(direction.note, width, "muted")
    lines = _wrapped(evidence_text(report), width, "muted") if extent.evidence else []
    for number, answer in enumerate(direction.answers):
        index = first + number
        size = f"{len(answer.changes)} change{'s' if len(answer.changes) > 1 else ''}"
        gain = report.gain_interval(answer.gain)
        head = f"{direction.mark(number)}{number + 1}  {size:<9}  {gain}"
        style: Style = "bold" if answer.evident else "plain"
        if width >= BESIDE:
            lines.append(Line(head, style, index, direction, number, max(_HEAD, len(head) + 1)))
        else:
            lines += [Line(head, style, index), Line("", style, index, direction, number, 4)]
        if extent.all_values or index == chosen:
            values = f"{answer.changes_text} ({', '.join(answer.factors)})"
            lines += [Line(f"    {part}", "plain", index)
                      for part in textwrap.wrap(values, max(8, width - 4))]  # fmt: skip
    if direction.answers:
        start = max((line.start for line in lines if line.direction is not None), default=4)
        lines = [_started(line, start) for line in lines]
        lines.append(Line("", "muted", None, direction, -1, start))
    if report.best is None:
        lines += _wrapped(report.verdict, width, "bold")
    return lines


def _started(line: Line, start: int) -> Line:
    """The line with its drawing from column `start` on."""
    if line.direction is None:
        return line
    return Line(line.text, line.style, line.index, line.direction, line.drawn, start)


def _details(direction: Direction, number: int, width: int, what: ChosenLines) -> list[Line]:
    """The chosen answer: how it is applied, fitted values and agreement, and its command."""
    name = "enter adjusts the real images live; there S saves them as a run"
    if direction.side == "sim":
        name = "enter copies the command"
    texts = [f"answer {number + 1}: {name}"]
    if what == "all":
        texts += details(direction, number)
    lines = [line for text in texts for line in _wrapped(text, width, "plain")]
    if what == "action":
        return lines
    return [*lines, *_wrapped(direction.commands[number], width, "muted")]


def _wrapped(text: str, width: int, style: Style, direction: Direction | None = None) -> list[Line]:
    parts = textwrap.wrap(text, max(8, width), break_on_hyphens=False)
    return [Line(part, style, direction=direction) for part in parts]
