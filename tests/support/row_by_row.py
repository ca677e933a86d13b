"""A slow second evaluation of expressions: Python's comparisons on the rows of view `pair`."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

from s2rstore.language import evaluation, expand, fields
from s2rstore.language import syntax_tree as n
from s2rstore.language.lasso import edges
from s2rstore.metrics import nearest_neighbours
from s2rstore.reader import Store
from s2rstore.records import SIDES, SPLITS, TRAINING_SPLITS
from s2rstore.security.printable_text import printable

_OPERATORS = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "=": operator.eq,
    "!=": operator.ne,
}  # fmt: skip
_PREDICTED = tuple(f"{side}_error_m" for side in SIDES)
_LISTS = {"has": "frame WHERE domain = ?", "health": "frame_fault WHERE fault = ?",
          "label": "frame_label JOIN label USING (label) WHERE name = ?"}  # fmt: skip
_TURN, _ROUNDING = 2 * math.pi, 1e-9

Row = dict[str, Any]


def select(
    store: Store,
    node: n.Node,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    with_trained: bool = False,
    saved: Mapping[str, n.Node] | None = None,
) -> list[int]:
    """The iids that `evaluation.select` gives, in order."""
    name = store.run_name(run)
    found = _Evaluation(store, name, trajectories, with_trained)
    expanded = expand(node, evaluation.vocabulary(store, saved))
    return sorted(found.selected(expanded) & (found.base(name) | found.unpaired()))


def _known(value: Any) -> bool:
    return value is not None and value == value


def _is_predicted(row: Row) -> bool:
    return all(_known(row[name]) for name in _PREDICTED)


def _is_new(row: Row) -> bool:
    return not any(row[f"{side}_split"] in TRAINING_SPLITS for side in SIDES)


class _Evaluation:
    def __init__(
        self, store: Store, run: str, trajectories: Sequence[str] | None, with_trained: bool
    ) -> None:
        self._store, self._run = store, run
        self._trajectories, self._with_trained = trajectories, with_trained
        self._rows = cache(self._read_rows)
        self._everything = set(range(len(store.instances)))

    def _read_rows(self, run: str) -> dict[int, Row]:
        """The rows of a run by iid; ranks are those among the instances that count."""
        query = f"SELECT * FROM {evaluation.rows_of_run(self._store, run)} WHERE run = ?"
        cursor = self._store.connection().execute(query, [run])
        names = [name for name, *_ in cursor.description or ()]
        rows = [dict(zip(names, values, strict=True)) for values in cursor.fetchall()]
        for side in () if self._with_trained else SIDES:
            error, rank = f"{side}_error_m", f"{side}_rank"
            ranked = [row for row in rows if _known(row[rank]) and _is_new(row)]
            for row in rows:
                row[rank] = None
            for place, row in enumerate(sorted(ranked, key=lambda r: (r[error], r["iid"])), 1):
                row[rank] = place
        return {row["iid"]: row for row in rows}

    def _is_in_view(self, row: Row) -> bool:
        return self._trajectories is None or row["trajectory"] in self._trajectories

    def base(self, run: str) -> set[int]:
        """The instances of a run that count."""
        return {
            iid for iid, row in self._rows(run).items()
            if _is_predicted(row) and self._is_in_view(row) and (self._with_trained or _is_new(row))
        }  # fmt: skip

    def unpaired(self) -> set[int]:
        rows, paired = self._rows(self._run), self._paired(self._run)
        lone = {i for i, row in rows.items() if self._is_in_view(row) and not _is_predicted(row)}
        return lone - paired

    def _paired(self, run: str) -> set[int]:
        record = self._store.run(run)
        return set.intersection(*(self._listed("has", record.domain(side)) for side in SIDES))

    def _listed(self, name: str, value: str) -> set[int]:
        return {iid for (iid,) in self._store.execute(f"SELECT iid FROM {_LISTS[name]}", [value])}

    def _values(self, field: n.Field) -> dict[int, Any]:
        """The known numbers of a field in the unit of the index, by iid."""
        run = self._run if fields.is_truth(field.name) else field.run or self._run
        column = fields.NUMERIC[field.name].column
        return {iid: row[column] for iid, row in self._rows(run).items() if _known(row[column])}

    def selected(self, node: n.Node) -> set[int]:
        match node:
            case n.Not(inner):
                return self._everything - self.selected(inner)
            case n.And():
                return self.selected(node.left) & self.selected(node.right)
            case n.Minus():
                return self.selected(node.left) - self.selected(node.right)
            case n.Or():
                return self.selected(node.left) | self.selected(node.right)
            case n.Everything():
                return self._everything
            case n.Nothing():
                return set()
            case n.Ids(ranges):
                return {i for i in self._everything for low, high in ranges if low <= i <= high}
            case n.Compare(field, sign, limit):
                scaled, holds = limit * fields.NUMERIC[field.name].scale, _OPERATORS[sign]
                return {i for i, value in self._values(field).items() if holds(value, scaled)}
            case n.Between() | n.Around():
                found = self._values(node.field).items()
                return {iid for iid, value in found if _is_in_range(node, value)}
            case n.Named():
                return self._named(node)
            case n.Extreme():
                return set(self._extremes(node))
            case n.Box() | n.Near() | n.Lasso():
                x, y = self._values(node.x), self._values(node.y)
                return {iid for iid in x.keys() & y.keys() if _is_inside(node, x[iid], y[iid])}
            case n.Like(side, iid, count, run):
                context = evaluation.context(
                    self._store, self._run, self._trajectories, with_trained=self._with_trained
                )
                name = run or self._run
                return set(nearest_neighbours.neighbours(
                    self._store, name, side, iid, count, context.population
                )[0].tolist())  # fmt: skip
            case n.LabelGain(label, sign, limit, run):
                sums = self._store.execute(
                    "SELECT iid, sum(gain) FROM label_gain JOIN label USING (label) "
                    "WHERE run = ? AND name = ? GROUP BY iid", [run or self._run, label],
                )  # fmt: skip
                return {iid for iid, gain in sums if _OPERATORS[sign](gain, limit)}
            case n.Paired(run):
                return self._paired(run or self._run)
            case n.Training(trained, run):
                rows = self._rows(run or self._run).items()
                return {i for i, row in rows if _is_predicted(row) and _is_new(row) != trained}
            case n.Bend(straight):
                bends = self._values(n.Field("curvature")).items()
                return {iid for iid, value in bends if (abs(value) < 10) == straight}
        raise TypeError(node)

    def _named(self, node: n.Named) -> set[int]:
        name, value = node.field.name, node.value
        if name in _LISTS:
            return self._listed(name, value)
        run = self._run if fields.is_truth(name) else node.field.run or self._run
        return {iid for iid, row in self._rows(run).items() if self._text(name, row) == value}

    def _text(self, name: str, row: Row) -> str | None:
        if name == "split":
            splits = [row[f"{side}_split"] for side in SIDES]
            return next((split for split in SPLITS if split in splits), None)
        if name not in ("sim.room", "real.room"):
            text: str | None = row[fields.TEXT[name].column]
            return printable(text) if name == "room" and text else text
        x, y = (row[f"{name.removesuffix('room')}{axis}_m".replace(".", "_")] for axis in "xy")
        held = (r for r in self._store.rooms if r.x0 <= x <= r.x1 and r.y0 <= y <= r.y1)
        return next((room.room for room in held), None) if _known(x) and _known(y) else None

    def _extremes(self, node: n.Extreme) -> Iterable[int]:
        base = self.base(node.field.run or self._run)
        count = math.ceil(node.amount * len(base) / 100) if node.percent else int(node.amount)
        sign = 1 if node.which == "best" else -1
        found = [(sign * v, i) for i, v in self._values(node.field).items() if i in base]
        return [iid for _, iid in sorted(found)[:count]]


def _is_in_range(node: n.Between | n.Around, value: float) -> bool:
    numeric = fields.NUMERIC[node.field.name]
    if isinstance(node, n.Between):
        if not numeric.angle:
            return node.low * numeric.scale <= value <= node.high * numeric.scale
        turned = (value - math.radians(node.low) + _ROUNDING) % _TURN
        width = math.radians((node.high - node.low) % 360)
        return node.high - node.low >= 360 or turned <= width + 2 * _ROUNDING
    if not numeric.angle:
        return abs(value - node.centre * numeric.scale) <= node.tolerance * numeric.scale
    off = abs(value - math.radians(node.centre)) % _TURN
    return min(off, _TURN - off) <= math.radians(node.tolerance) + _ROUNDING


def _is_inside(node: n.Box | n.Near | n.Lasso, x: float, y: float) -> bool:
    if isinstance(node, n.Box):
        x0, y0, x1, y1 = node.corners
        return x0 <= x <= x1 and y0 <= y <= y1
    if isinstance(node, n.Near):
        dx, dy = x - node.centre[0], y - node.centre[1]
        return dx * dx + dy * dy <= node.radius * node.radius
    crossed = (
        edge.low <= y < edge.high and x < (y - edge.low) / edge.rise * edge.run + edge.x
        for edge in edges(node.corners)
    )
    return sum(crossed) % 2 == 1
