"""Translators: fitted maps that make images of one domain look like those of another.

Registry: `METHODS` maps a method's name to a `TranslationMethod`. To add a method, write one module
with a `Translator` and a fit function, and add one line to `METHODS`.
"""

from __future__ import annotations

from s2rstore.errors import RequestError
from s2rtools.translation import (
    cut,
    cyclegan,
    fda,
    grayworld,
    histogram,
    identity,
    mkl,
    reinhard,
    residual,
    style,
    style_network,
    unit,
)
from s2rtools.translation.method import TranslationMethod

__all__ = ["METHODS", "TranslationMethod", "find_method"]

METHODS: dict[str, TranslationMethod] = {
    method.name: method
    for method in (
        identity.METHOD,
        grayworld.METHOD,
        reinhard.METHOD,
        mkl.METHOD,
        histogram.METHOD,
        fda.METHOD,
        residual.METHOD,
        style.METHOD,
        style_network.METHOD,
        cut.METHOD,
        cyclegan.METHOD,
        unit.METHOD,
    )
}


def find_method(name: str) -> TranslationMethod:
    """A method by name. Raises RequestError for unknown names."""
    if name not in METHODS:
        raise RequestError(f"translation method {name!r}: one of {', '.join(METHODS)}")
    return METHODS[name]
