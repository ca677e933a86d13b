"""Why the real side differs: `FACTORS` lists the reasons. Adding one is a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from s2rstore.errors import RequestError
from s2rtools.synthetic_world.factors.camera import Mount
from s2rtools.synthetic_world.factors.depth_sensor import DepthSensor
from s2rtools.synthetic_world.factors.exposure import Exposure
from s2rtools.synthetic_world.factors.factor import Factor
from s2rtools.synthetic_world.factors.lights import Lights
from s2rtools.synthetic_world.factors.objects import Objects
from s2rtools.synthetic_world.factors.robot import Latency, Wheels
from s2rtools.synthetic_world.factors.sensor import Sensor

__all__ = ["FACTORS", "Factor", "Severities", "active", "severities"]

Severities = Mapping[str, float]

FACTORS: dict[str, Factor] = {
    factor.name: factor
    for factor in (
        Lights(),
        Exposure(),
        Sensor(),
        DepthSensor(),
        Mount(),
        Objects(),
        Latency(),
        Wheels(),
    )
}


def severities(given: Severities | None = None) -> dict[str, float]:
    """Severity of every factor: 1 by default, as `given` for those that it names.

    Raises RequestError for unknown names and severities outside 0 .. 2.
    """
    chosen = dict.fromkeys(FACTORS, 1.0)
    for name, value in (given or {}).items():
        if name not in FACTORS:
            raise RequestError(f"factor {name!r}: one of {', '.join(FACTORS)}; or all, none")
        if not 0 <= value <= 2:
            raise RequestError(f"factor {name}: severity 0 .. 2, not {value:g}")
        chosen[name] = float(value)
    return chosen


def active(given: Severities) -> list[tuple[Factor, float]]:
    """The factors that do something, in the one order in which they act."""
    return [(factor, given[name]) for name, factor in FACTORS.items() if given.get(name, 0) > 0]


def parse_factors(text: str) -> dict[str, float]:
    """Severities from `lights=0.5,objects`: those that are not named are 0; `all`, `none`.

    Raises RequestError for what it cannot read.
    """
    if text in ("", "all"):
        return severities()
    chosen = dict.fromkeys(FACTORS, 0.0)
    named: set[str] = set()
    for item in text.split(",") if text != "none" else ():
        name, equals, value = (part.strip() for part in item.partition("="))
        if name in named:
            raise RequestError(f"--factors {text}: {name} is named twice")
        named.add(name)
        try:
            severity = float(value) if equals else 1.0
        except ValueError as error:
            raise RequestError(f"--factors {item}: {value!r} is no number") from error
        chosen[name] = severities({name: severity})[name]
    return chosen
