"""Random expressions on stores with extreme and missing values: numpy and SQL must agree.

    python -m bench.expressions [--examples 20000] [--seeds 1,2,3]

For every seed a store is generated, and both back ends of the language evaluate the examples.
Prints the numbers of equal results, of equal errors and of differences; the exit code is 1 if any
result differs.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import duckdb
import numpy as np

import s2rstore
from bench import index_store
from bench.edited_index import edited
from s2rstore.errors import RequestError
from s2rstore.language import evaluation, fields, to_text
from s2rstore.language import syntax_tree as n
from s2rstore.reader import Store

INSTANCES = 64
RUNS = ("vanilla", "dataaug")
COLUMNS = {
    "instance": ("x", "y", "heading", "curvature", "timestamp"),
    "prediction": (
        "x",
        "y",
        "heading",
        "sigma",
        "error",
        "heading_error",
        "loss",
        "accuracy",
        "outlier",
    ),
    "projection": ("u", "v"),
}
EXTREMES = (
    "NULL", "NULL", "'NaN'::DOUBLE", "'inf'::DOUBLE", "'-inf'::DOUBLE", "0.0", "-0.0::DOUBLE",
    "5e-324::DOUBLE", "1e-308::DOUBLE", "1.7976931348623157e308::DOUBLE", "-1e308::DOUBLE", "1e154",
    "8.0", "10.0", "pi()", "-pi()", "nextafter(10.0::DOUBLE, 11.0::DOUBLE)", "16.0", "1e6",
)  # fmt: skip
NUMBERS = (0.0, 1.0, -1.0, 8.0, 10.0, 16.0, 180.0, -180.0, 1e-300, 5e-324, 1e9, -1e9, 0.1, 24.0)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.expressions", description=__doc__)
    parser.add_argument("--examples", type=int, default=20_000, help="per seed")
    parser.add_argument("--seeds", default="1,2,3")
    options = parser.parse_args()
    differed = 0
    for seed in map(int, options.seeds.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            path = extreme_store(Path(folder) / "extreme.s2r", random.Random(seed))
            with s2rstore.open(path) as store:
                counts = compare(store, random.Random(seed), options.examples)
        differed += counts["differ"]
        print(f"seed {seed}: " + ", ".join(f"{counts[key]} {key}" for key in sorted(counts)))
    return 1 if differed else 0


def extreme_store(path: Path, rng: random.Random) -> Path:
    """A store with missing, infinite and extreme numbers in its index."""
    index_store.build(path, INSTANCES, seed=rng.randrange(2**31))
    statements = []
    for table, columns in COLUMNS.items():
        for column in columns:
            for _ in range(4):
                value, every = rng.choice(EXTREMES), rng.randint(2, 9)
                where = f"(iid * 7 + {rng.randrange(100)}) % {every} = 0"
                if table != "instance" and rng.random() < 0.6:
                    where += f" AND side = '{rng.choice(['sim', 'real'])}'"
                statements.append(f'UPDATE "{table}" SET "{column}" = {value} WHERE {where}')
    statements += [
        f"DELETE FROM prediction WHERE run = 'dataaug' AND iid % {rng.randint(5, 20)} = 1",
        f"DELETE FROM projection WHERE iid % {rng.randint(3, 9)} = 2",
        f"UPDATE instance SET room = NULL WHERE iid % {rng.randint(3, 9)} = 0",
        "UPDATE room SET x1 = x1 + 5, y0 = y0 - 2 WHERE position % 3 = 0",
        "UPDATE room SET room = 'room 1' WHERE position = 7",
    ]
    edited(path, statements)
    return path


def compare(store: Store, rng: random.Random, examples: int) -> Counter[str]:
    """Count equal results, equal errors and differences; print each difference."""
    counts: Counter[str] = Counter({"agree": 0, "differ": 0})
    make = Maker(rng)
    for _ in range(examples):
        text = to_text(make.expression())
        run = rng.choice(RUNS)
        view = rng.choice([None, None, ("walk-00",), ("walk-01", "walk-05"), ()])
        ours, theirs = _by_masks(store, text, run, view), _by_sql(store, text, run, view)
        if ours != theirs:
            counts["differ"] += 1
            print(f"{text}\n  run {run}, trajectories {view}\n  numpy {ours}\n  SQL   {theirs}")
        else:
            counts["refuse alike" if isinstance(ours, str) else "agree"] += 1
    return counts


def _by_masks(
    store: Store, text: str, run: str, view: tuple[str, ...] | None
) -> tuple[int, ...] | str:
    try:
        return tuple(np.flatnonzero(evaluation.select(store, text, run, view)).tolist())
    except RequestError as error:
        return str(error)


def _by_sql(
    store: Store, text: str, run: str, view: tuple[str, ...] | None
) -> tuple[int, ...] | str:
    try:
        query, parameters = evaluation.sql(store, text, run, view)
        return tuple(row[0] for row in store.execute(query, parameters))
    except (RequestError, duckdb.Error) as error:
        return str(error)


class Maker:
    """Generates random expressions with every kind of node."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._leaves: tuple[Callable[[], n.Node], ...] = (
            n.Everything, n.Nothing, self._bend, self._ids, self._compare, self._compare,
            self._between, self._around, self._named, self._extreme, self._extreme, self._box,
            self._near, self._lasso,
        )  # fmt: skip

    def expression(self, depth: int = 0) -> n.Node:
        rng = self._rng
        if depth > 4 or rng.random() < 0.45:
            return rng.choice(self._leaves)()
        if rng.random() < 0.25:
            return n.Not(self.expression(depth + 1))
        joined = rng.choice((n.And, n.Minus, n.Or))
        return joined(self.expression(depth + 1), self.expression(depth + 1))

    def _number(self) -> float:
        rng = self._rng
        if rng.random() < 0.003:
            return 1e300  # refused
        return rng.choice((
            rng.choice(NUMBERS), float(rng.randint(-20, 50)), round(rng.uniform(-60, 60), 3),
            math.ldexp(rng.uniform(-1, 1), rng.randint(-1000, 20)),
        ))  # fmt: skip

    def _field(self) -> n.Field:
        return n.Field(self._rng.choice(sorted(fields.NUMERIC)), self._run())

    def _run(self) -> str | None:
        return self._rng.choice([None, None, *RUNS])

    def _plane(self) -> tuple[n.Field, n.Field]:
        run = self._run()
        x, y = self._rng.choice(sorted(fields.PLANES.values()))
        return n.Field(x, run), n.Field(y, run)

    def _pair(self) -> tuple[float, float]:
        first, second = self._number(), self._number()
        return min(first, second), max(first, second)

    def _bend(self) -> n.Node:
        return n.Bend(self._rng.random() < 0.5)

    def _ids(self) -> n.Node:
        low, high = sorted(self._rng.randint(0, INSTANCES + 5) for _ in range(2))
        return n.Ids(((low, high),))

    def _compare(self) -> n.Node:
        operator = self._rng.choice(["<", "<=", ">", ">=", "=", "!="])
        return n.Compare(self._field(), operator, self._number())

    def _between(self) -> n.Node:
        field = self._field()
        ends = self._number(), self._number()
        return n.Between(field, *(ends if fields.NUMERIC[field.name].angle else sorted(ends)))

    def _around(self) -> n.Node:
        return n.Around(self._field(), self._number(), abs(self._number()))

    def _named(self) -> n.Node:
        name = self._rng.choice(sorted(fields.TEXT))
        values = {
            "rooms": [f"room {self._rng.randint(1, 12)}"],
            "trajectories": [f"walk-{self._rng.randint(0, 15):02d}"],
            "splits": ["train", "validation", "test", "unseen"],
            "domains": ("sim", "real"),
        }[fields.TEXT[name].vocabulary]
        return n.Named(n.Field(name, self._run()), self._rng.choice(values))

    def _extreme(self) -> n.Node:
        percent = self._rng.random() < 0.6
        amount = self._rng.choice([0.0, 15.0, 100.0, float(self._rng.randint(0, 100))])
        if percent and self._rng.random() < 0.2:
            amount = round(self._rng.uniform(0, 100), 4)
        return n.Extreme(self._rng.choice(["worst", "best"]), amount, percent, self._field())

    def _box(self) -> n.Node:
        (x0, x1), (y0, y1) = self._pair(), self._pair()
        return n.Box(*self._plane(), (x0, y0, x1, y1))

    def _near(self) -> n.Node:
        return n.Near(*self._plane(), (self._number(), self._number()), abs(self._number()))

    def _lasso(self) -> n.Node:
        corners = tuple(self._corners(self._rng.randint(3, 8)))
        return n.Lasso(*self._plane(), corners)

    def _corners(self, count: int) -> Iterator[tuple[float, float]]:
        for _ in range(count):
            yield self._number(), self._number()


if __name__ == "__main__":
    sys.exit(main())
