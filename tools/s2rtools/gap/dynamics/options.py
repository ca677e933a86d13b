"""Options NAME=VALUE of the dynamics and delay axes, as `--dynamics` takes them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any

from s2rstore.errors import RequestError
from s2rtools.gap.axis_result import Axis
from s2rtools.gap.delay.delay_axis import BAD_STATES, DelayAxis
from s2rtools.gap.dynamics.ape_rpe import SCALES, DriveErrorOptions, LogAlignment, RpeStep
from s2rtools.gap.dynamics.dynamics_axis import DynamicsAxis
from s2rtools.gap.dynamics.noise_floor import Noise
from s2rtools.gap.dynamics.windows import WindowPlan

MAX_REACH = 60.0
"""Longest delay that can be searched, s."""
_PARTS = ("rigid", "reflection", "scale")


def axes(texts: Sequence[str]) -> dict[str, Axis]:
    """Both axes, configured by options NAME=VALUE.

    Raises RequestError for unknown and repeated names and for invalid values.
    """
    options: dict[str, Any] = {}
    for option in texts:
        name, equals, value = (part.strip() for part in option.partition("="))
        if not equals or name not in OPTIONS:
            raise RequestError(
                f"--dynamics {option}: expected NAME=VALUE with NAME one of {', '.join(OPTIONS)}"
            )
        if name in options:
            raise RequestError(f"--dynamics {option}: {name} is repeated")
        try:
            options[name] = OPTIONS[name](value)
        except RequestError as error:
            raise RequestError(f"--dynamics {option}: {error}") from error

    def arguments(**names: str) -> dict[str, Any]:
        return {target: options[name] for name, target in names.items() if name in options}

    search = arguments(reach="max_delay")
    dynamics = arguments(horizons="plan", nrmse="scale", noise="noise")
    errors = DriveErrorOptions(**arguments(align="alignment", rpe="step"))
    delay = arguments(bad="bad_state", period="period")
    return {
        "dynamics": DynamicsAxis(**dynamics, **search, drive_errors=errors),
        "delay": DelayAxis(**delay, **search),
    }


def _horizons(text: str) -> WindowPlan:
    """Horizons in seconds; windows start every half of the shortest one."""
    horizons = tuple(_number(part, "seconds such as 0.5,1,2") for part in text.split(","))
    if not all(0 < horizon <= 3600 for horizon in horizons):
        raise RequestError("expected seconds above 0, up to 3600")
    return WindowPlan(horizons, stride=0.5 * horizons[0])


def _one_of(known: Collection[str]) -> Callable[[str], str]:
    def parse(text: str) -> str:
        if text not in known:
            raise RequestError(f"expected one of {', '.join(known)}")
        return text

    return parse


def _align(text: str) -> LogAlignment:
    parts = [] if text == "none" else text.split("+")
    known = set(parts) <= set(_PARTS) and len(set(parts)) == len(parts)
    if not known or (parts and "rigid" not in parts):
        raise RequestError("expected none, or rigid with any of +reflection and +scale")
    return LogAlignment(*(part in parts for part in _PARTS))


def _rpe(text: str) -> RpeStep:
    expected = "seconds such as 1s, or a number of poses such as 25"
    if text.endswith("s"):
        return RpeStep(seconds=_number(text[:-1], expected, 3600.0))
    poses = _number(text, expected, 1e9)
    if poses != int(poses):
        raise RequestError(f"expected {expected}")
    return RpeStep(poses=int(poses))


def _noise(text: str) -> Noise | None:
    if text == "measured":
        return None
    expected = "measured, or metres and radians such as 0.002,0.003"
    values = [_number(part, expected) for part in text.split(",")]
    if len(values) != 2 or min(values) < 0:
        raise RequestError(f"expected {expected}")
    return Noise(*values)


def _number(text: str, expected: str, most: float | None = None) -> float:
    """A finite number; with `most`, above 0 and up to `most`."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (most is not None and not 0 < value <= most):
        raise RequestError(f"expected {expected}")
    return value


OPTIONS: dict[str, Callable[[str], Any]] = {
    "horizons": _horizons,
    "nrmse": _one_of(SCALES),
    "align": _align,
    "rpe": _rpe,
    "reach": lambda text: _number(text, f"seconds up to {MAX_REACH:g} such as 0.5", MAX_REACH),
    "bad": _one_of(BAD_STATES),
    "period": lambda text: _number(text, "seconds such as 0.05", 60.0),
    "noise": _noise,
}
