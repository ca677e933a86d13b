"""Translators: fitted maps that make images of one domain look like those of another.

Registry: `METHODS` maps a method's name to a `TranslationMethod`. To add a method, write one module
here that defines `METHOD`, and add one line to `_MODULES`. A module is imported when its method is
used, because the learned methods need torch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from s2rstore.errors import RequestError
from s2rtools.translation.method import TranslationMethod

__all__ = ["METHODS", "TranslationMethod", "find_method"]

_MODULES = {
    "identity": "identity",
    "grayworld": "grayworld",
    "levels": "levels",
    "reinhard": "reinhard",
    "mkl": "mkl",
    "histogram": "histogram",
    "fda": "fda",
    "style": "style",
    "style-network": "style_network",
    "cut": "cut",
    "cyclegan": "cyclegan",
    "unit": "unit",
    "mkl+residual": "residual",
}


class _Methods(Mapping[str, TranslationMethod]):
    """The methods by name; a module is imported at the first access to its method."""

    def __getitem__(self, name: str) -> TranslationMethod:
        method = import_module(f"s2rtools.translation.{_MODULES[name]}").METHOD
        assert isinstance(method, TranslationMethod)
        return method

    def __iter__(self) -> Iterator[str]:
        return iter(_MODULES)

    def __len__(self) -> int:
        return len(_MODULES)


METHODS: Mapping[str, TranslationMethod] = _Methods()


def find_method(name: str) -> TranslationMethod:
    """A method by name. Raises RequestError for unknown names."""
    if name not in METHODS:
        raise RequestError(f"translation method {name!r}: one of {', '.join(METHODS)}")
    return METHODS[name]
