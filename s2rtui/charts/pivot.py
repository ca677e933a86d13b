"""The pivot: a figure of the real errors by two groupings, as a table of coloured cells."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from s2rstore.findings.groups import GroupErrors, parts_of
from s2rtui.canvas import PlotArea, Point
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pane, Table, View
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.scale import non_empty
from s2rtui.drawing.table import Cell, Column, Row, TableSpec
from s2rtui.session.error_groups import FIGURES, pivot_grouping
from s2rtui.session.session import Session

DEGREES = " deg"
EVIDENT = "*"
"""The mark of cells whose interval does not hold the median of all."""
_NAMES = ("n", "median_m", "low_m", "high_m", "recall", "share", "evident", "expression")


class PivotView(View):
    name = "pivot"
    has_rows = True
    key = ")"
    pane: Pane = "centre"
    description = "real errors by two groupings, such as room and heading: n, median, recall, share"
    loads = ("cells",)
    brushable = False
    counts_instances = False

    def subtitle(self, scene: Scene) -> str:
        figure = FIGURES[scene.state.figure]
        return f"{figure.meaning} by {self._title(scene)} (\\: figure, O *: groups)"

    def _title(self, scene: Scene) -> str:
        return " and ".join(parts_of(pivot_grouping(scene.state)))

    def input(self, scene: Scene) -> dict[tuple[str, str], GroupErrors]:
        """The cells by the names of their groups; none until they are computed."""
        loaded = scene.loaded.current_cells(scene.state)
        rows = loaded.rows if loaded is not None else ()
        return {(row.group.parts[0], row.group.parts[1]): row for row in rows}

    def _sides(self, scene: Scene) -> tuple[list[str], list[str]]:
        """The names of the rows and of the columns."""
        pairs = list(self.input(scene))
        rows = list(dict.fromkeys(first for first, _ in pairs))
        columns = list(dict.fromkeys(second for _, second in pairs))
        if columns[0].endswith(DEGREES):
            columns.sort(key=lambda name: float(name.split()[0]))
        return rows, columns

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        return *super().cache_key(scene), pivot_grouping(scene.state), scene.state.figure

    def missing(self, scene: Scene) -> tuple[str, ...]:
        if scene.loaded.current_cells(scene.state) is None:
            return (scene.loaded.failed.get("cells", "errors are being computed"),)
        return () if self.input(scene) else ("no instances",)

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        cells, figure = self.input(scene), FIGURES[scene.state.figure]
        rows, names = self._sides(scene)
        values = {pair: figure.factor * _value(cell, figure.name) for pair, cell in cells.items()}
        known = [value for value in values.values() if math.isfinite(value)]
        low, high = non_empty(0.0, max(known, default=1.0))
        middle = _middle(scene)

        evident = {pair for pair, cell in cells.items() if _is_evident(cell, middle)}

        def cell(pair: tuple[str, str]) -> Cell:
            value = values.get(pair, math.nan)
            if not math.isfinite(value):
                return Cell("-" if pair in cells else "")
            mark = EVIDENT if pair in evident else " " if evident else ""
            text = _short(value, figure.unit == "m")
            return Cell(f"{text}{mark}", heat=float(np.clip((value - low) / (high - low), 0, 1)))

        made = tuple(Row((Cell(row), *(cell((row, name)) for name in names))) for row in rows)
        chosen = self.chosen_row(scene)
        place, column = (None, -1) if chosen is None else divmod(chosen, len(names))
        heads = [  # those that are the farthest from the chosen one are left out first
            Column(name.removesuffix(DEGREES), right=True, rank=abs(at - column), panel=name)
            for at, name in enumerate(names)
        ]
        first = Column(self._title(scene).split()[0], least=10)
        table = TableSpec((first, *heads), made, chosen=place, column=column + 1)
        bar = ColourBar(figure.meaning, figure.unit, (low, high))
        note = (
            f"{EVIDENT} evident: the 95 % interval does not hold the median of all, {middle:.2f} m"
        )
        lost = _not_localised(scene)
        left_out = f"{lost} not localised left out" if lost else ""
        notes = [*([note] if evident else []), *([left_out] if lost else [])]
        return Drawing(table=table, notes=((bar,), *notes))

    def row_names(self, scene: Scene) -> Sequence[str]:
        """The names of all cells, row by row; those without instances, too."""
        if not self.input(scene):
            return []
        rows, columns = self._sides(scene)
        return [f"{row}, {column}" for row in rows for column in columns]

    def row_width(self, scene: Scene) -> int:
        return len(self._sides(scene)[1]) if self.input(scene) else 1

    def first_choice(self, scene: Scene) -> int:
        """The cell with the largest median that has an interval; without any, that which holds
        the largest share of all errors.
        """

        def badness(pair: tuple[str, str]) -> tuple[bool, float]:
            cell = cells[pair]
            return cell.real.is_known, cell.real.value if cell.real.is_known else cell.share

        cells = self.input(scene)
        first, second = max(cells, key=badness)
        rows, columns = self._sides(scene)
        return rows.index(first) * len(columns) + columns.index(second)

    def row_expression(self, scene: Scene, row: int) -> str:
        cell = self.input(scene).get(self._pair(scene, row))
        return cell.group.expression if cell is not None else "none"

    def _pair(self, scene: Scene, row: int) -> tuple[str, str]:
        rows, columns = self._sides(scene)
        place, column = divmod(row, len(columns))
        return rows[place], columns[column]

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        _, columns = self._sides(scene)
        place = round(point[1]) * len(columns) + columns.index(panel.name)
        self.select_row(session, scene, place)

    def numbers(self, scene: Scene) -> Table:
        cells, middle = self.input(scene), _middle(scene)
        rows = []
        for pair, cell in cells.items():
            low, high = (None if math.isnan(end) else end for end in cell.real.bounds)
            evident = "yes" if _is_evident(cell, middle) else "no"
            rows.append((*pair, cell.n, cell.real.value, low, high, cell.recall, cell.share,
                         evident, cell.group.expression))  # fmt: skip
        return (*parts_of(pivot_grouping(scene.state)), *_NAMES), rows

    def heading(self, scene: Scene) -> tuple[str, str]:
        figure = FIGURES[scene.state.figure]
        title = f"{scene.title}: {figure.meaning} by {self._title(scene)}"
        return title, f"{scene.store.dataset.name}  ·  instances new to the run"


def _not_localised(scene: Scene) -> int:
    """The instances of the groups for which the run gave no pose."""
    state, store = scene.state, scene.store
    columns = store.run_columns(state.run)
    return int((state.population.attempted(store.instances, columns) & ~columns.valid).sum())


def _value(cell: GroupErrors, figure: str) -> float:
    return {"median": cell.real.value, "n": cell.n, "recall": cell.recall, "share": cell.share}[
        figure
    ]


def _middle(scene: Scene) -> float:
    """The median real error of all instances, metres."""
    errors = scene.store.run_columns(scene.state.run).real.error[scene.state.base]
    known = errors[np.isfinite(errors)]
    return float(np.median(known)) if known.size else math.nan


def _is_evident(cell: GroupErrors, middle: float) -> bool:
    """Whether the interval of a median lies above or below the median of all."""
    return cell.real.is_known and not cell.real.low <= middle <= cell.real.high


def _short(value: float, is_metres: bool) -> str:
    """At most four characters."""
    return f"{value:.0f}" if not is_metres else f"{value:.1f}" if value >= 9.995 else f"{value:.2f}"


VIEW = PivotView()
