"""Factors: reasons why the real side of the synthetic world differs from the simulated one.

Registry: `FACTORS` maps a factor's name to a `Factor`. To add a factor, write one module with a
subclass of `Factor` and add one line to `FACTORS`. The order seeds the noise: append at the end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace

from s2rstore.errors import RequestError
from s2rstore.records import GAP_FACTORS
from s2rtools.synthetic_world.factors.camera import CameraMount, Exposure
from s2rtools.synthetic_world.factors.factor import Factor
from s2rtools.synthetic_world.factors.robot import Latency, Wheels
from s2rtools.synthetic_world.factors.scene_changes import Lights, Objects
from s2rtools.synthetic_world.factors.sensors import DepthSensor, Sensor

__all__ = [
    "FACTORS",
    "FACTOR_GROUPS",
    "Factor",
    "Severities",
    "active_factors",
    "complete_severities",
    "configured_factors",
    "parse_constants",
    "parse_factors",
]

Severities = Mapping[str, float]

FACTOR_GROUPS = GAP_FACTORS
"""Groups of factors, in the order of the shares of the gap."""

FACTORS: dict[str, Factor] = {
    factor.name: factor
    for factor in (
        Lights(),
        Exposure(),
        Sensor(),
        DepthSensor(),
        CameraMount(),
        Objects(),
        Latency(),
        Wheels(),
    )
}


def complete_severities(requested: Severities | None = None) -> dict[str, float]:
    """Severity of every factor: as `requested`, 1 for factors that are not named.

    Raises RequestError for unknown names and severities outside 0 .. 2.
    """
    complete = dict.fromkeys(FACTORS, 1.0)
    for name, value in (requested or {}).items():
        if name not in FACTORS:
            raise RequestError(f"factor {name!r}: one of {', '.join(FACTORS)}; or all, none")
        if not 0 <= value <= 2:
            raise RequestError(f"factor {name}: severity 0 .. 2, not {value:g}")
        complete[name] = float(value)
    return complete


def active_factors(
    severities: Severities, factors: Mapping[str, Factor] = FACTORS
) -> list[tuple[Factor, float]]:
    """The factors with a severity above 0, in the order in which they are applied."""
    return [(f, severities[name]) for name, f in factors.items() if severities.get(name, 0) > 0]


def scene_severities(severities: Severities) -> dict[str, float]:
    """The severities of the factors that change the scene itself."""
    return {name: value for name, value in severities.items() if FACTORS[name].shapes_scene}


def configured_factors(constants: Mapping[str, float]) -> dict[str, Factor]:
    """The factors with other constants, such as `{"exposure.vignette": 0.4}`.

    Raises RequestError for unknown names and values that are no number within +-100.
    """
    configured = dict(FACTORS)
    known = [f"{name}.{constant}" for name, f in FACTORS.items() for constant in _constants(f)]
    for key, value in constants.items():
        if key not in known:
            raise RequestError(f"constant {key!r}: one of {', '.join(known)}")
        if not (isinstance(value, int | float) and math.isfinite(value) and abs(value) <= 100):
            raise RequestError(f"constant {key}: {value!r} is not a number within +-100")
        name, _, constant = key.partition(".")
        configured[name] = replace(configured[name], **{constant: float(value)})  # type: ignore[type-var]
    return configured


def _constants(factor: Factor) -> list[str]:
    return [each.name for each in fields(factor)] if is_dataclass(factor) else []


def parse_constants(text: str) -> dict[str, float]:
    """Constants from a text such as `exposure.vignette=0.4,depth.farthest=5`.

    Raises RequestError for malformed texts.
    """
    parsed: dict[str, float] = {}
    for item in text.split(",") if text else ():
        name, _, value = (part.strip() for part in item.partition("="))
        if name in parsed:
            raise RequestError(f"--constants {text}: {name} is named twice")
        try:
            parsed[name] = float(value)
        except ValueError as error:
            raise RequestError(f"--constants {item}: {value!r} is not a number") from error
    configured_factors(parsed)
    return parsed


def parse_factors(text: str) -> dict[str, float]:
    """Severities from a text such as `lights=0.5,objects`, `all` or `none`; others are 0.

    Raises RequestError for malformed texts.
    """
    if text in ("", "all"):
        return complete_severities()
    parsed = dict.fromkeys(FACTORS, 0.0)
    named: set[str] = set()
    for item in text.split(",") if text != "none" else ():
        name, equals, value = (part.strip() for part in item.partition("="))
        if name in named:
            raise RequestError(f"--factors {text}: {name} is named twice")
        named.add(name)
        try:
            severity = float(value) if equals else 1.0
        except ValueError as error:
            raise RequestError(f"--factors {item}: {value!r} is not a number") from error
        parsed[name] = complete_severities({name: severity})[name]
    return parsed
