"""The candidates of which none has both fewer changes and a lower cost than another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from s2rtools.suggestions.search import Candidate


def pareto_front(candidates: Iterable[Candidate], start: float) -> list[Candidate]:
    """Non-dominated candidates that cost less than `start`, by number of changes, ascending."""
    front: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda each: (each.changes, each.cost)):
        if candidate.cost < (front[-1].cost if front else start):
            front.append(candidate)
    return front


def net_gain(candidate: Candidate, start: float, price: float) -> float:
    """Decrease of the cost minus `price` times `start` for each change."""
    return start - candidate.cost - price * start * candidate.changes


def preferred(front: Sequence[Candidate], start: float, price: float) -> int | None:
    """The place of the candidate with the largest net gain; None where none pays its price."""
    gains = [net_gain(candidate, start, price) for candidate in front]
    best = max(range(len(front)), key=lambda place: gains[place], default=None)
    return best if best is not None and gains[best] > 0 else None
