"""Parts that installed packages add, such as views, layouts and heatmaps, by entry points.

A package declares a part in the group of its kind, `s2r.KINDs`, under the name of the part. One
that cannot be used is left out, and `s2r doctor` says why. Plug-ins come from installed packages
alone: nothing in a store names or loads one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from s2rstore.errors import RequestError, first_line
from s2rstore.security.printable_text import printable

T = TypeVar("T")
DISABLED = "S2R_NO_PLUGINS"
"""Environment variable that turns plug-ins off for this process and those that it starts."""
KINDS = (
    "layout", "heatmap", "adjustment", "translator", "metric", "view", "renderer", "architecture",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Plugin:
    """A part that a package declares; `problem` says why it is left out, empty where it is used."""

    kind: str
    name: str
    value: str
    package: str
    problem: str = ""

    def __str__(self) -> str:
        return printable(f"{self.kind} {self.name} of {self.package} ({self.value})")


_REGISTRIES: dict[str, Registry[Any]] = {}


def left_out() -> list[str]:
    """A line about each part that was left out of a registry that this process has used."""
    used = [each for each in _REGISTRIES.values() if "plugins" in vars(each)]
    return [f"{each}: {each.problem}" for registry in used for each in registry.plugins
            if each.problem]  # fmt: skip


def group_of(kind: str) -> str:
    """The group of entry points of a kind."""
    return f"s2r.{kind}s"


def declared(kind: str) -> list[EntryPoint]:
    """The entry points that installed packages declare for a kind, by name."""
    if os.environ.get(DISABLED):
        return []
    return sorted(entry_points(group=group_of(kind)), key=lambda each: (each.name, each.value))


class Registry(MutableMapping[str, T]):
    """The parts of one kind by name: the project's own, then those of installed packages.

    `check` gets the name and the object of a part, and the parts before it; it returns the part or
    raises RequestError. Own parts may be texts `module:ATTRIBUTE`, imported when they are used.
    """

    def __init__(
        self,
        kind: str,
        own: Mapping[str, T | str],
        check: Callable[[str, Any, Mapping[str, T | str]], T],
    ) -> None:
        self.kind = kind
        self._parts: dict[str, T | str] = dict(own)
        self._check = check
        _REGISTRIES[kind] = self

    @cached_property
    def plugins(self) -> tuple[Plugin, ...]:
        """The declared parts of installed packages, which are loaded by this."""
        found = []
        for entry in declared(self.kind):
            package = f"{entry.dist.name} {entry.dist.version}" if entry.dist else "?"
            problem = self._add(entry)
            found.append(Plugin(self.kind, entry.name, entry.value, package, problem))
        return tuple(found)

    def _add(self, entry: EntryPoint) -> str:
        """Add a part of a package; why it is left out, empty where it is not."""
        if entry.name in self._parts:
            return "the name is taken"
        try:
            self._parts[entry.name] = self._check(entry.name, entry.load(), self._parts)
        except RequestError as error:
            return str(error)
        except Exception as error:  # code of others may raise anything
            return f"cannot be loaded: {printable(first_line(error))}"
        return ""

    def find(self, name: str) -> T:
        """A part by name. Raises RequestError for an unknown one, and for one that is left out."""
        if name in self:
            return self[name]
        for each in self.plugins:
            if each.name == name:
                raise RequestError(f"{each} is left out: {each.problem}")
        raise RequestError(f"{self.kind} {name!r}: one of {', '.join(self)}")

    @property
    def _every(self) -> dict[str, T | str]:
        """The parts with those of packages."""
        _ = self.plugins
        return self._parts

    def __getitem__(self, name: str) -> T:
        part = self._parts[name] if name in self._parts else self._every[name]
        if isinstance(part, str):
            entry = EntryPoint(name, part, group_of(self.kind))
            part = self._parts[name] = self._check(name, entry.load(), {})
        return part

    def __setitem__(self, name: str, part: T) -> None:
        self._parts[name] = part

    def __delitem__(self, name: str) -> None:
        del self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._every)

    def __len__(self) -> int:
        return len(self._every)

    def __contains__(self, name: object) -> bool:
        return name in self._parts or name in self._every


def instance_of(kind: type[Any]) -> Callable[[str, Any, Mapping[str, Any]], Any]:
    """The check of a part that has to be an instance of a class, with the name as its `name`."""

    def check(name: str, part: Any, others: Mapping[str, Any]) -> Any:
        if not isinstance(part, kind) or getattr(part, "name", name) != name:
            raise RequestError(f"is no {kind.__name__} named {name!r}")
        return part

    return check
