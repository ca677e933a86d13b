"""The syntax tree of a selection: frozen nodes, compared without their columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from dataclasses import field as attribute
from typing import Literal

from s2rstore.records import Side

Operator = Literal["<", "<=", ">", ">=", "=", "!="]


@dataclass(frozen=True)
class Field:
    """A column by its name in the language, of the named run or (None) the current one."""

    name: str
    run: str | None = None


@dataclass(frozen=True)
class Everything:
    """`all`: the base population, and the instances in view without an image of a side."""


@dataclass(frozen=True)
class Nothing:
    """`none`: the empty set."""


@dataclass(frozen=True)
class Ids:
    """`ids(3, 7..12)`: closed ranges of instances."""

    ranges: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, iids: Iterable[int]) -> Ids:
        """Select instances by number; consecutive numbers become one range."""
        ranges: list[tuple[int, int]] = []
        for iid in sorted(map(int, iids)):
            if ranges and iid <= ranges[-1][1] + 1:
                ranges[-1] = ranges[-1][0], iid
            else:
                ranges.append((iid, iid))
        return cls(tuple(ranges))


@dataclass(frozen=True)
class Compare:
    """`gap >= 2`."""

    field: Field
    operator: Operator
    value: float


@dataclass(frozen=True)
class Between:
    """`seq:100..200`, both ends included; for headings, from the first turning to the second."""

    field: Field
    low: float
    high: float


@dataclass(frozen=True)
class Around:
    """`heading:90+-20`: within a tolerance of a centre."""

    field: Field
    centre: float
    tolerance: float


@dataclass(frozen=True)
class Named:
    """`room:right`, `traj:a`, `sim.split:train`: a text column equals a name."""

    field: Field
    value: str
    column: int = attribute(default=0, compare=False)


@dataclass(frozen=True)
class Extreme:
    """`worst(20%, sim.error)`: the largest values of the base population; `best` the smallest."""

    which: Literal["worst", "best"]
    amount: float
    percent: bool
    field: Field


@dataclass(frozen=True)
class Box:
    """`box(x0, y0, x1, y1)` over two columns, edges included."""

    x: Field
    y: Field
    corners: tuple[float, float, float, float]


@dataclass(frozen=True)
class Near:
    """`near(x, y, radius)` over two columns, the circle included."""

    x: Field
    y: Field
    centre: tuple[float, float]
    radius: float


@dataclass(frozen=True)
class Lasso:
    """`lasso(x0, y0, x1, y1, x2, y2, ...)` over two columns: a polygon by the even-odd rule."""

    x: Field
    y: Field
    corners: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Like:
    """`like(iid, count)`: an instance and its nearest neighbours in one side's embeddings."""

    side: Side
    iid: int
    count: int
    run: str | None = None
    column: int = attribute(default=1, compare=False)


@dataclass(frozen=True)
class LabelGain:
    """`harm.label("chair") > 0.2`: what the objects of a class cost the real prediction, metres."""

    label: str
    operator: Operator
    value: float
    run: str | None = None
    column: int = attribute(default=1, compare=False)


@dataclass(frozen=True)
class Bend:
    """`straight` (|curvature| < 10 degrees) or `curved` (the others)."""

    straight: bool


@dataclass(frozen=True)
class Paired:
    """`paired`: the instances with an image in both domains of a run."""

    run: str | None = None


@dataclass(frozen=True)
class Training:
    """`trained` (an image is in split `train` or `validation`) or `new` (the others)."""

    trained: bool
    run: str | None = None


@dataclass(frozen=True)
class Saved:
    """`@name`: a saved selection."""

    name: str
    column: int = attribute(default=0, compare=False)


@dataclass(frozen=True)
class Not:
    inner: Node


@dataclass(frozen=True, eq=False)
class Operation:
    """Two expressions that an operator joins; a long chain is compared in a loop."""

    left: Node
    right: Node

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Operation) and self._operands == other._operands

    def __hash__(self) -> int:
        return hash(self._operands)

    @property
    def _operands(self) -> tuple[object, ...]:
        first, links = chain(self)
        return first, *((type(link), link.right) for link in links)


class And(Operation):
    """`&`: the instances of both."""


class Minus(Operation):
    """`-`: the instances of the left without those of the right."""


class Or(Operation):
    """`|`: the instances of either."""


Node = (
    Everything | Nothing | Ids | Compare | Between | Around | Named | Extreme | Box | Near | Lasso
    | Like | LabelGain | Bend | Paired | Training | Saved | Not | Operation
)  # fmt: skip


def leaves(node: Node) -> list[Node]:
    """Every node without operands, from left to right."""
    operands: list[Node] = []
    waiting = [node]
    while waiting:
        node = waiting.pop()
        if isinstance(node, Not):
            waiting.append(node.inner)
        elif isinstance(node, Operation):
            waiting += [node.right, node.left]
        else:
            operands.append(node)
    return operands


def with_leaves(node: Node, others: Iterator[Node]) -> Node:
    """The same tree with other leaves, which come from left to right."""
    first, links = chain(node)
    result = Not(with_leaves(first.inner, others)) if isinstance(first, Not) else next(others)
    for link in links:
        result = type(link)(result, with_leaves(link.right, others))
    return result


def chain(node: Node) -> tuple[Node, list[Operation]]:
    """The first operand of a chain of operators, and the operators in order."""
    links: list[Operation] = []
    while isinstance(node, Operation):
        links.append(node)
        node = node.left
    return node, links[::-1]
