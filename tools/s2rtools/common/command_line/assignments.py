"""Repeatable arguments of the form NAME=VALUE."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from s2rstore.errors import RequestError


def parse_assignments(
    option: str, arguments: Iterable[str], known: Collection[str] | None = None
) -> dict[str, str]:
    """The values of `option` NAME=VALUE by name.

    Raises RequestError for another form, a name that is not `known`, and a repeated one.
    """
    values: dict[str, str] = {}
    for argument in arguments:
        name, equals, value = (part.strip() for part in argument.partition("="))
        if not equals or not name or (known is not None and name not in known):
            names = "" if known is None else f" with NAME one of {', '.join(known) or 'none'}"
            raise RequestError(f"{option} {argument}: expected NAME=VALUE{names}")
        if name in values:
            raise RequestError(f"{option} {argument}: {name} is repeated")
        values[name] = value
    return values


def parse_number(option: str, name: str, value: str) -> float:
    """The number of `option` NAME=VALUE. Raises RequestError for what is none."""
    try:
        return float(value)
    except ValueError:
        raise RequestError(f"{option} {name}={value}: must be a number") from None
