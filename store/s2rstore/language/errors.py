"""What is wrong with an expression, at which column, and what could stand there."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from s2rstore.errors import RequestError


class ExpressionError(RequestError):
    """A wrong expression; `column` counts from 1, `expected` says what could stand there."""

    def __init__(self, column: int, problem: str, expected: Iterable[str] = ()) -> None:
        self.column = column
        self.expected = tuple(expected)
        hint = f"; could be {', '.join(self.expected)}" if self.expected else ""
        super().__init__(f"column {column}: {problem}{hint}")


def unknown(column: int, what: str, name: str, known: Iterable[str]) -> ExpressionError:
    """An unknown name, with the nearest known ones first."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5) or names[:8]
    problem = f"no {what} {name!r}"
    return ExpressionError(column, problem if near else f"{problem}, nor any other", near)
