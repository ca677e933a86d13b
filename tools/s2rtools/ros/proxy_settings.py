"""Settings of the proxy: those given at the start, and those that may change while it runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from s2rstore.errors import RequestError
from s2rtools.translation.translator_file import StoredTranslator

LoadTranslator = Callable[[str], StoredTranslator]

NO_LIMIT = 0.0
"""The value of the ROS parameter `max_age` that means no limit."""
INPUT_QUALITY = 0
"""Value of the ROS parameter `jpeg_quality` that keeps the quality of the input."""


@dataclass(frozen=True, slots=True, eq=False)
class ProxySettings:
    """Settings that may change while the proxy runs.

    `name` is the file or name of the translator, `strength` the share of the translation (0
    forwards images unchanged), `max_age` in seconds or None, `jpeg_quality` 1 to 100 or None for
    that of the input. Where `enabled` is False, images are forwarded unchanged.
    """

    name: str
    translator: StoredTranslator
    strength: float = 1.0
    max_age: float | None = None
    jpeg_quality: int | None = None
    enabled: bool = True

    def parameters(self) -> dict[str, Any]:
        """The settings as ROS parameters."""
        return {
            "translator": self.name,
            "strength": float(self.strength),
            "max_age": NO_LIMIT if self.max_age is None else float(self.max_age),
            "jpeg_quality": INPUT_QUALITY if self.jpeg_quality is None else self.jpeg_quality,
            "enabled": self.enabled,
        }

    def changed(self, parameters: Mapping[str, Any], load: LoadTranslator) -> ProxySettings:
        """The settings with some ROS parameters changed; unknown ones are ignored.

        Raises RequestError that names a parameter with a wrong value.
        """
        new: dict[str, Any] = {}
        if "strength" in parameters:
            new["strength"] = checked_strength(parameters["strength"], "strength")
        if "max_age" in parameters:
            new["max_age"] = _number(parameters["max_age"], "max_age", 0, math.inf) or None
        if "jpeg_quality" in parameters:
            quality = _number(parameters["jpeg_quality"], "jpeg_quality", 0, 100)
            new["jpeg_quality"] = int(quality) or None
        if "enabled" in parameters:
            if not isinstance(parameters["enabled"], bool):
                raise RequestError(f"enabled {parameters['enabled']!r}: must be true or false")
            new["enabled"] = parameters["enabled"]
        name = parameters.get("translator", self.name)
        if name != self.name:
            if not isinstance(name, str):
                raise RequestError(f"translator {name!r}: must be a file or a name")
            new |= {"name": name, "translator": load(name)}
        return replace(self, **new)


@dataclass(frozen=True, slots=True, eq=False)
class ProxyRequest:
    """A proxy to run: its topics, settings at the start, and how to load further translators.

    `arguments` are those of ROS, such as remappings `FROM:=TO`.
    """

    input_topic: str
    output_topic: str
    settings: ProxySettings
    load: LoadTranslator
    node_name: str = "translation_proxy"
    arguments: tuple[str, ...] = ()


def parse_age(text: str) -> float:
    """Seconds of a duration such as `100ms`, `0.1s` or `0.1`. Raises RequestError."""
    number, factor = text.strip(), 1.0
    for suffix, scale in (("ms", 1e-3), ("s", 1.0)):
        if number.endswith(suffix):
            number, factor = number.removesuffix(suffix), scale
            break
    try:
        age = float(number) * factor
    except ValueError:
        age = math.nan
    if not 0 < age < math.inf:
        raise RequestError(f"--max-age {text}: must be a duration such as 100ms or 0.1s")
    return age


def checked_strength(value: Any, what: str) -> float:
    """A strength between 0 and 1. Raises RequestError, which begins with `what`."""
    return _number(value, what, 0, 1)


def _number(value: Any, what: str, lowest: float, highest: float) -> float:
    number = not isinstance(value, bool) and isinstance(value, int | float)
    if not number or not lowest <= value <= highest or not math.isfinite(value):
        limits = f"at least {lowest:g}" if highest == math.inf else f"{lowest:g} to {highest:g}"
        raise RequestError(f"{what} {value!r}: must be a number, {limits}")
    return float(value)
