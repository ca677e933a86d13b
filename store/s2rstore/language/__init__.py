"""Selections as a language: text, tree, and two back ends that agree.

`parse` gives the tree, `to_text` its canonical text, `mask` a boolean mask over dense columns and
`to_sql` a query with bound parameters. A `Query` is a tree with the instances that count.
"""

from s2rstore.errors import ExpressionError
from s2rstore.language.canonical_text import located, quoted, to_text
from s2rstore.language.completion import complete
from s2rstore.language.name_resolution import Neighbours, Vocabulary, expand
from s2rstore.language.numpy_backend import MaskContext, base_population, mask
from s2rstore.language.query import Query
from s2rstore.language.sql_backend import SqlContext, to_sql
from s2rstore.language.syntax_tree import Node


def parse(text: str) -> Node:
    """The tree of an expression; an empty text means `all`.

    Raises ExpressionError with the column and the valid alternatives. The grammar is loaded on
    first use, because the application's first screen needs none.
    """
    from s2rstore.language.parser import parse as parse_text

    return parse_text(text)


def check_size(text: str) -> None:
    """Raise ExpressionError for a text that is too large to be parsed."""
    from s2rstore.language.parser import check_size as check

    check(text)


__all__ = [
    "ExpressionError",
    "MaskContext",
    "Neighbours",
    "Node",
    "Query",
    "SqlContext",
    "Vocabulary",
    "base_population",
    "check_size",
    "complete",
    "expand",
    "located",
    "mask",
    "parse",
    "quoted",
    "to_sql",
    "to_text",
]
