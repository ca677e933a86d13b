"""What is wrong with an expression, at which column, and what could stand there."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

from s2rstore.errors import RequestError


class ExpressionError(RequestError):
    """A wrong expression; `column` counts from 1, `expected` says what could stand there."""

    def __init__(self, column: int, problem: str, expected: Iterable[str] = ()) -> None:
        self.column = column
        self.expected = tuple(expected)
        hint = f"; could be {', '.join(self.expected)}" if self.expected else ""
        super().__init__(f"column {column}: {shortened(problem, _LONGEST_PROBLEM)}{hint}")


_LONGEST, _MOST = 100, 2000
"""Names that are compared with an unknown one: others would take too long."""
_LONGEST_PROBLEM = 400


def unknown(column: int, what: str, name: str, known: Iterable[str]) -> ExpressionError:
    """An unknown name, with the nearest known ones first."""
    names = [shortened(each) for each in islice(known, _MOST)]
    near = difflib.get_close_matches(name[:_LONGEST], names, n=3, cutoff=0.5) or names[:8]
    problem = f"no {what} {shortened(name)!r}"
    return ExpressionError(column, problem if near else f"{problem}, nor any other", near)


def shortened(text: str, most: int = _LONGEST) -> str:
    """A text as it stands in a message: at most `most` characters."""
    return text if len(text) <= most else f"{text[: most - 3]}..."
