"""Translators: fitted maps that make images of one domain look like those of another.

Registry: `METHODS` maps a method's name to a `TranslationMethod`. To add a method, write one module
here that defines a `TranslationMethod`, and add one line to `OWN`. A package outside of this
project adds one by an entry point of the group `s2r.translators` whose name is that of the method.
Methods are imported when they are used, because the learned ones need torch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points

from s2rstore.errors import RequestError, first_line
from s2rstore.security.printable_text import printable
from s2rtools.translation.method import TranslationMethod

__all__ = ["METHODS", "TranslationMethod", "find_method"]

ENTRY_POINTS = "s2r.translators"
OWN = (
    ("identity", "colour_maps:IDENTITY"),
    ("grayworld", "colour_maps:GRAYWORLD"),
    ("levels", "colour_maps:LEVELS"),
    ("reinhard", "colour_maps:REINHARD"),
    ("mkl", "colour_maps:MKL"),
    ("histogram", "colour_maps:HISTOGRAM"),
    ("fda", "fda:METHOD"),
    ("style", "style:METHOD"),
    ("style-network", "style_network:METHOD"),
    ("cut", "cut:METHOD"),
    ("cyclegan", "cyclegan:METHOD"),
    ("unit", "unit:METHOD"),
    ("mkl+residual", "residual:METHOD"),
)
"""Names of the methods, in the order in which they are listed, and where they are defined."""


class _Methods(Mapping[str, TranslationMethod]):
    """The methods by name, those of installed packages last."""

    @cached_property
    def _entries(self) -> dict[str, EntryPoint]:
        """Raises RequestError where a package takes the name of another method."""
        entries = {
            name: EntryPoint(name, f"s2rtools.translation.{where}", ENTRY_POINTS)
            for name, where in OWN
        }
        for entry in sorted(entry_points(group=ENTRY_POINTS), key=lambda each: each.name):
            if entry.name in entries:
                raise RequestError(f"translator {entry.name}: {entry.value}: the name is taken")
            entries[entry.name] = entry
        return entries

    def __getitem__(self, name: str) -> TranslationMethod:
        """Raises RequestError where the method of a package cannot be used."""
        entry = self._entries[name]
        what = f"translator {name}: {entry.value}"
        try:
            method = entry.load()
        except Exception as error:  # code of others may raise anything
            message = f"{what} cannot be loaded: {printable(first_line(error))}"
            raise RequestError(message) from error
        if not isinstance(method, TranslationMethod) or method.name != name:
            raise RequestError(f"{what} is no TranslationMethod named {name!r}")
        return method

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, name: object) -> bool:
        return name in self._entries


METHODS: Mapping[str, TranslationMethod] = _Methods()


def find_method(name: str) -> TranslationMethod:
    """A method by name. Raises RequestError for unknown names."""
    if name not in METHODS:
        raise RequestError(f"translation method {name!r}: one of {', '.join(METHODS)}")
    return METHODS[name]
