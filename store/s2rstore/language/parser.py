"""From text to nodes."""

from __future__ import annotations

import re
from functools import cache, lru_cache
from importlib import resources
from typing import Any, Literal, cast

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken, VisitError

from s2rstore.errors import ExpressionError, unknown
from s2rstore.language import fields
from s2rstore.language import syntax_tree as tree
from s2rstore.language.functions import Call, Head, apply, compared, numeric
from s2rstore.security.printable_text import printable

_EXPECTED = {
    "NAME": "a word, field or function",
    "NUMBER": "a number",
    "STRING": 'a "quoted" name',
    "BANG": "!",
    "LPAR": "(",
    "RPAR": ")",
    "AT": "@saved",
    "AND": "&",
    "MINUS": "-",
    "PLUS": "+",
    "VBAR": "|",
    "COMPARE": "a comparison such as >",
    "COLON": ":",
    "COMMA": ",",
    "PERCENT": "%",
    "DOTTED": ".field",
    "$END": "the end",
    "__ANON_0": "..",
    "__ANON_1": "+-",
}
MAX_LENGTH, MAX_DEPTH, MAX_TERMS, MAX_NUMBER = 20_000, 100, 200, 1e12
_QUOTED = re.compile(r'"(?:\\.|[^"\\])*"')
_SHORT: dict[str, Literal["worst", "best"]] = {
    "worst15": "worst",
    "min15": "worst",
    "best15": "best",
    "max15": "best",
}


@lru_cache(64)
def parse(text: str) -> tree.Node:
    """The tree of an expression. Raises ExpressionError with the column and the valid alternatives.

    An empty text means `all`.
    """
    if not text.strip():
        return tree.Everything()
    check_size(text)
    try:
        return cast(tree.Node, _parser().parse(text))
    except VisitError as error:
        if isinstance(error.orig_exc, ExpressionError):
            raise error.orig_exc from None
        raise
    except UnexpectedCharacters as error:
        raise ExpressionError(error.column, f"{text[error.column - 1]!r} has no meaning") from None
    except UnexpectedToken as error:
        raise _unexpected(error, text) from None
    except UnexpectedInput as error:
        raise ExpressionError(getattr(error, "column", 1), "cannot be read") from None


def check_size(text: str) -> None:
    """Raise ExpressionError where an expression is too large, before it exhausts the stack."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(MAX_LENGTH, f"longer than {MAX_LENGTH} characters")
    bare = _QUOTED.sub(lambda match: "_" * len(match[0]), text)
    if sum(bare.count(sign) for sign in "&|") > MAX_TERMS or bare.count(" - ") > MAX_TERMS:
        raise ExpressionError(1, f"more than {MAX_TERMS} parts; save some of it and use @name")
    groups, signs = [0], 0  # the depth of each open parenthesis; ! before an operand
    for column, character in enumerate(bare, 1):
        if character == "!":
            signs += 1
        elif character == "(":
            groups.append(groups[-1] + signs + 1)
            signs = 0
        elif not character.isspace():
            signs = 0
            if character == ")" and len(groups) > 1:
                groups.pop()
        if groups[-1] + signs > MAX_DEPTH:
            raise ExpressionError(column, f"more than {MAX_DEPTH} of ( and ! within each other")


@cache
def _parser() -> Lark:
    grammar = (resources.files("s2rstore.language") / "grammar.lark").read_text()
    return Lark(grammar, parser="lalr", transformer=_Build(), maybe_placeholders=False)


def _unexpected(error: UnexpectedToken, text: str) -> ExpressionError:
    token = error.token
    ended = token.type == "$END"
    column = len(text.rstrip()) + 1 if ended else int(token.column or 1)
    expected = sorted({_EXPECTED.get(name, name) for name in error.accepts or error.expected})
    return ExpressionError(
        column, "ends too early" if ended else f"unexpected {str(token)!r}", expected
    )


def _tagged(kind: str) -> Any:
    """A method of `_Build` that returns its argument with its kind."""
    return lambda self, value: (kind, value)


@v_args(inline=True)
class _Build(Transformer[Token, Any]):
    """Builds nodes bottom up; every problem is an ExpressionError."""

    def start(self, node: tree.Node) -> tree.Node:
        return node

    number, percent, field, name = map(_tagged, ("number", "percent", "field", "name"))

    def either(self, first: tree.Node, *rest: tree.Node) -> tree.Node:
        for node in rest:
            first = tree.Or(first, node)
        return first

    def both(self, first: tree.Node, *rest: Any) -> tree.Node:
        for sign, node in zip(rest[::2], rest[1::2], strict=True):
            first = tree.And(first, node) if sign.type == "AND" else tree.Minus(first, node)
        return first

    def negation(self, inner: tree.Node) -> tree.Node:
        return tree.Not(inner)

    def head(self, name: Token | Head) -> Head:
        return _head(name)

    def dotted(self, call: Call, rest: Token) -> Head:
        if call.name != "run" or [kind for kind, _ in call.arguments] != ["text"]:
            raise ExpressionError(call.column, "only a run has fields", ['run("name").field'])
        return Head(fields.of_name(str(rest)[1:]), call.column, call.arguments[0][1])

    def call(self, name: Token, arguments: list[Any]) -> Call:
        return Call(str(name), int(name.column or 1), arguments)

    def run_call(self, head: Head, arguments: list[Any]) -> Call:
        return Call(head.name, head.column, arguments, head.run)

    def arguments(self, *items: Any) -> list[Any]:
        return list(items)

    def signed(self, *tokens: Token) -> tuple[float, str]:
        text = "".join(tokens)
        if abs(float(text)) > MAX_NUMBER:
            raise ExpressionError(int(tokens[0].column or 1), f"{text} is beyond {MAX_NUMBER:g}")
        return float(text), text

    def span(self, low: tuple[float, str], high: tuple[float, str]) -> Any:
        return "span", (low[0], high[0])

    def around(self, centre: tuple[float, str], tolerance: tuple[float, str]) -> Any:
        return "around", (centre[0], tolerance[0])

    def text(self, token: Token) -> Any:
        return "text", _unquoted(token)

    def label(self, token: Token) -> tuple[str, int]:
        return _unquoted(token), int(token.column or 1)

    def saved(self, at: Token, label: tuple[str, int]) -> tree.Node:
        return tree.Saved(label[0], int(at.column or 1))

    def word(self, name: Token | Head) -> tree.Node:
        head = _head(name)
        if head.name in _SHORT:
            return tree.Extreme(_SHORT[head.name], 15.0, True, tree.Field("real.error", head.run))
        if head.run is None and head.name in ("all", "none"):
            return tree.Everything() if head.name == "all" else tree.Nothing()
        if head.run is None and head.name in ("straight", "curved"):
            return tree.Bend(head.name == "straight")
        if head.name == "paired":
            return tree.Paired(head.run)
        if head.name in ("new", "trained"):
            return tree.Training(head.name == "trained", head.run)
        after = head.column + len(name if isinstance(name, Token) else head.name)
        if head.name in fields.NUMERIC or head.name in fields.TEXT:
            raise ExpressionError(after, f"{head.name} needs a condition", [" > 1", ":value"])
        if head.name in fields.FUNCTIONS:
            raise ExpressionError(after, f"{head.name} needs ( and its arguments")
        if field := fields.meant(head.name):
            condition = ":value" if field in fields.TEXT else " > 1"
            raise unknown(head.column, "field", head.name, [field + condition])
        words = list(fields.RUN_WORDS if head.run else [*fields.WORDS, *fields.FUNCTIONS])
        raise unknown(head.column, "word", head.name, words)

    def comparison(self, head: Head, operator: Token, value: tuple[float, str]) -> tree.Node:
        return tree.Compare(numeric(head), cast(Any, str(operator)), value[0])

    def tag(self, head: Head, value: Any) -> tree.Node:
        kind, content = value
        if head.name in fields.TEXT:
            if kind not in ("name", "number"):
                raise ExpressionError(head.column, f"{head.name}: takes one name")
            name = content[0] if kind == "name" else content[1]
            column = content[1] if kind == "name" else head.column
            return tree.Named(tree.Field(head.name, head.run), name, column)
        if kind == "name" and head.name not in fields.NUMERIC:
            meant = fields.meant(head.name)
            known = [meant] if meant else [*fields.TEXT, *fields.NUMERIC]
            raise unknown(head.column, "field", head.name, known)
        field = numeric(head)
        if kind == "span":
            if content[0] > content[1] and not fields.NUMERIC[field.name].angle:
                raise ExpressionError(head.column, "the range's first end is above its second")
            return tree.Between(field, *content)
        if kind == "around":
            if content[1] < 0:
                raise ExpressionError(head.column, "the tolerance is below 0")
            return tree.Around(field, *content)
        if kind == "number":
            return tree.Between(field, content[0], content[0])
        raise ExpressionError(content[1], f"{head.name}: takes a number", ["1..5", "90+-20"])

    def function(self, call: Call) -> tree.Node:
        return apply(call)

    def call_comparison(self, call: Call, operator: Token, value: tuple[float, str]) -> tree.Node:
        return compared(call, cast(Any, str(operator)), value[0])


def _head(name: Token | Head) -> Head:
    if isinstance(name, Head):
        return name
    return Head(fields.of_name(str(name)), int(name.column or 1))


def _unquoted(token: Token) -> str:
    text = str(token)
    return printable(re.sub(r"\\(.)", r"\1", text[1:-1])) if token.type == "STRING" else text
