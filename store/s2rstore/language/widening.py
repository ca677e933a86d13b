"""What an expression that selects nothing would select if one of its terms were wider.

In an expression without negation around a term, an instance is selected where the term holds and
the others allow it. So the expression with `all` in place of the term gives the instances that the
term alone excludes, and the term is widened just far enough to hold the nearest of them; a bound
such as `real.error > 1000` to hold the nearest `NEAREST_PERCENT` %.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from s2rstore.errors import ExpressionError
from s2rstore.geometry import angles
from s2rstore.language import fields
from s2rstore.language import syntax_tree as tree
from s2rstore.language.canonical_text import to_text
from s2rstore.language.numpy_backend import (
    Mask,
    MaskContext,
    Values,
    base_population,
    field_values,
    mask,
)
from s2rstore.language.parser import parse

MAX_TERMS = 12
"""Expressions with more terms are not widened."""
MAX_WORK = 4_000_000
"""Expressions with more terms times instances are not widened: it would take over 50 ms."""
NEAREST_PERCENT = 15
"""Share of the instances that a term alone excludes that a wider bound holds, as `worst15`."""
_PERCENT = (*range(1, 5), *range(5, 101, 5))
"""Percentages that `best` and `worst` are widened to."""

Rebuild = Callable[[tree.Node], tree.Node]


@dataclass(frozen=True, slots=True)
class Widening:
    """A wider expression `node` with the number of instances that it selects.

    `change` is the term that differs, as `best(30%, sim.error)` or `without room:lab`. `admitted`
    is the share of the base population that the wider term holds in addition, 0 .. 1.
    """

    node: tree.Node
    change: str
    count: int
    admitted: float

    @property
    def text(self) -> str:
        return to_text(self.node)


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A wider expression; `admitted` as in `Widening`."""

    node: tree.Node
    change: str
    admitted: float


def widenings(node: tree.Node, context: MaskContext, most: int = 2) -> list[Widening]:
    """The wider expressions that select something and differ least from `node`, at most `most`.

    `node` selects nothing. Each result has one wider percentage, bound, radius or range, or one
    term less; the first admits the fewest additional instances. Empty where nothing helps, and for
    expressions of more than `MAX_TERMS` terms or `MAX_WORK` terms times instances.
    """
    terms = len(tree.leaves(node))
    if terms > MAX_TERMS or terms * len(context.instances) > MAX_WORK:
        return []
    found: dict[tree.Node, _Candidate] = {}
    for candidate in _candidates(node, lambda whole: whole, context):
        found.setdefault(candidate.node, candidate)
    results = []
    for candidate in sorted(found.values(), key=lambda one: one.admitted):
        count = int(np.count_nonzero(mask(candidate.node, context)))
        if count and _can_be_typed(candidate.node):
            results.append(Widening(candidate.node, candidate.change, count, candidate.admitted))
        if len(results) == most:
            break
    return results


def _can_be_typed(node: tree.Node) -> bool:
    """Whether the parser takes the text; not so with numbers beyond its limit."""
    try:
        parse(to_text(node))
    except ExpressionError:
        return False
    return True


def _candidates(node: tree.Node, rebuild: Rebuild, context: MaskContext) -> Iterator[_Candidate]:
    """Wider forms of a part of the expression; `rebuild` puts the part into the whole."""
    if isinstance(node, tree.Not):
        return
    if not isinstance(node, tree.Operation):
        yield from _wider_term(node, rebuild, context)
        return
    left, right, kind = node.left, node.right, type(node)
    total = _size(tree.Everything(), context)
    if kind is tree.And:
        for one, other in ((left, right), (right, left)):
            if not isinstance(one, tree.And | tree.Minus):
                excluded = (total - _size(one, context)) / max(total, 1)
                yield _Candidate(rebuild(other), f"without {to_text(one)}", excluded)
    if kind is tree.Minus:
        excluded = _size(right, context) / max(total, 1)
        yield _Candidate(rebuild(left), f"without - {to_text(right)}", excluded)
    yield from _candidates(left, lambda wider: rebuild(kind(wider, right)), context)
    if kind is not tree.Minus:
        yield from _candidates(right, lambda wider: rebuild(kind(left, wider)), context)


def _wider_term(term: tree.Node, rebuild: Rebuild, context: MaskContext) -> Iterator[_Candidate]:
    excluded = mask(rebuild(tree.Everything()), context)
    if not excluded.any():
        return
    wider = _widened(term, excluded, context)
    if wider is not None and wider != term:
        admitted = _size(wider, context) - _size(term, context)
        total = max(_size(tree.Everything(), context), 1)
        yield _Candidate(rebuild(wider), to_text(wider), admitted / total)


def _size(node: tree.Node, context: MaskContext) -> int:
    return int(np.count_nonzero(mask(node, context)))


def _widened(term: tree.Node, excluded: Mask, context: MaskContext) -> tree.Node | None:
    """The term, just wide enough for the nearest of the excluded instances (N,); None if none."""
    match term:
        case tree.Extreme():
            return _wider_extreme(term, excluded, context)
        case tree.Compare():
            values = _known(term.field, excluded, context)
            return _wider_comparison(term, values) if values.size else None
        case tree.Between():
            values = _known(term.field, excluded, context)
            return _wider_range(term, values) if values.size else None
        case tree.Around():
            values = _known(term.field, excluded, context)
            return _wider_tolerance(term, values) if values.size else None
        case tree.Box() | tree.Near():
            x, y = (field_values(field, context)[excluded] for field in (term.x, term.y))
            known = np.isfinite(x) & np.isfinite(y)
            if not known.any():
                return None
            wider = _wider_box if isinstance(term, tree.Box) else _wider_circle
            return wider(term, x[known], y[known])  # type: ignore[arg-type]
        case _:
            return None


def _known(field: tree.Field, excluded: Mask, context: MaskContext) -> Values:
    """The known values of a field of the excluded instances, in the unit of the language."""
    values = field_values(field, context)[excluded] / fields.NUMERIC[field.name].scale
    return values[np.isfinite(values)]


def _wider_extreme(term: tree.Extreme, excluded: Mask, context: MaskContext) -> tree.Extreme | None:
    base = base_population(context, term.field.run)
    keys = field_values(term.field, context)
    keys = -keys if term.which == "worst" else keys
    candidates = np.flatnonzero(excluded & base & ~np.isnan(keys))
    if not candidates.size:
        return None
    first = int(candidates[keys[candidates].argmin()])
    ahead = base & (keys < keys[first])
    ties = base[:first] & (keys[:first] == keys[first])
    needed = int(np.count_nonzero(ahead)) + int(np.count_nonzero(ties)) + 1
    if not term.percent:
        return replace(term, amount=float(needed))
    total = int(np.count_nonzero(base))
    for percent in _PERCENT:
        if percent > term.amount and math.ceil(percent * total / 100) >= needed:
            return replace(term, amount=float(percent))
    return None


def _wider_comparison(term: tree.Compare, values: Values) -> tree.Node | None:
    place = math.ceil(NEAREST_PERCENT * values.size / 100) - 1
    if term.operator in (">=", ">"):
        nearest = float(-np.partition(-values, place)[place])
        limit = min(term.value, nearest + _spread(values, nearest))
        bound = _outwards(nearest, limit, -1, term.operator == ">")
    elif term.operator in ("<=", "<"):
        nearest = float(np.partition(values, place)[place])
        limit = max(term.value, nearest - _spread(values, nearest))
        bound = _outwards(nearest, limit, 1, term.operator == "<")
    elif term.operator == "=":
        return _wider_tolerance(tree.Around(term.field, term.value, 0.0), values)
    else:
        return None
    return replace(term, value=bound)


def _spread(values: Values, nearest: float) -> float:
    """The range of the values, of equal ones their size: a bound has two digits of it."""
    return float(np.ptp(values)) or abs(nearest) or math.inf


def _wider_range(term: tree.Between, values: Values) -> tree.Between | None:
    if fields.NUMERIC[term.field.name].angle:
        before, after = (term.low - values) % 360, (values - term.high) % 360
        grown = math.ceil(min(before.min(), after.min()))
        if (term.high - term.low) % 360 + grown >= 360:
            return None
        if before.min() <= after.min():
            return replace(term, low=float(angles.wrap_degrees(term.low - grown)))
        return replace(term, high=float(angles.wrap_degrees(term.high + grown)))
    nearest = float(values[np.maximum(term.low - values, values - term.high).argmin()])
    if nearest < term.low:
        return replace(term, low=_outwards(nearest, term.low, -1))
    return replace(term, high=_outwards(nearest, term.high, 1))


def _wider_tolerance(term: tree.Around, values: Values) -> tree.Around:
    apart = values - term.centre
    if fields.NUMERIC[term.field.name].angle:
        apart = angles.wrap_degrees(apart)
    return replace(term, tolerance=_outwards(float(np.abs(apart).min()), term.tolerance, 1))


def _wider_circle(term: tree.Near, x: Values, y: Values) -> tree.Near:
    distance = float(np.hypot(x - term.centre[0], y - term.centre[1]).min())
    return replace(term, radius=_outwards(distance, term.radius, 1))


def _wider_box(term: tree.Box, x: Values, y: Values) -> tree.Box:
    x0, y0, x1, y1 = term.corners
    beyond = np.maximum(np.maximum(x0 - x, x - x1), np.maximum(y0 - y, y - y1))
    nearest = int(beyond.argmin())
    at_x, at_y = float(x[nearest]), float(y[nearest])
    corners = (
        _outwards(at_x, x0, -1) if at_x < x0 else x0,
        _outwards(at_y, y0, -1) if at_y < y0 else y0,
        _outwards(at_x, x1, 1) if at_x > x1 else x1,
        _outwards(at_y, y1, 1) if at_y > y1 else y1,
    )
    return replace(term, corners=corners)


def _outwards(value: float, limit: float, sign: int, strict: bool = False) -> float:
    """A short number at `value`, or a little farther in the direction of `sign` (-1 or 1).

    It has two digits of the distance from the present `limit`. `strict`: not `value` itself.
    """
    distance = abs(value - limit)
    if not 1e-12 < distance < 1e12:
        return float(np.nextafter(value, sign * math.inf)) if strict else value
    digits = 1 - math.floor(math.log10(distance))
    scaled = value * 10.0**digits
    number = round((math.ceil(scaled) if sign > 0 else math.floor(scaled)) / 10.0**digits, digits)
    if (number - value) * sign > 0 or (number == value and not strict):
        return float(number)
    return float(round(number + sign * 10.0**-digits, digits))
