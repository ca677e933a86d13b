"""What may be asked of the two axes of motion, as words NAME=VALUE."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from s2rstore.errors import RequestError
from s2rtools.gap.axis_result import Axis
from s2rtools.gap.delay.delay_axis import BAD_STATES, DelayAxis
from s2rtools.gap.dynamics.ape_rpe import Whole
from s2rtools.gap.dynamics.dynamics_axis import Dynamics
from s2rtools.gap.dynamics.noise_floor import Noise
from s2rtools.gap.dynamics.pose_errors import SCALES, LogAlignment, Step
from s2rtools.gap.dynamics.windows import WindowPlan

MOST_REACH = 60.0
"""s"""
_PARTS = ("rigid", "reflection", "scale")


def axes(words: Sequence[str]) -> dict[str, Axis]:
    """Both axes as `words` ask for them.

    Raises RequestError for a name that is not known or stands twice, and for a value that is wrong.
    """
    given: dict[str, Any] = {}
    for word in words:
        name, found, text = (part.strip() for part in word.partition("="))
        if not found or name not in OPTIONS:
            raise RequestError(f"--dynamics {word}: give NAME=VALUE of {', '.join(OPTIONS)}")
        if name in given:
            raise RequestError(f"--dynamics {word}: {name} stands twice")
        try:
            given[name] = OPTIONS[name](text)
        except RequestError as error:
            raise RequestError(f"--dynamics {word}: {error}") from error
    both = _named(given, {"reach": "furthest"})
    mine = _named(given, {"horizons": "plan", "nrmse": "scale", "noise": "noise"})
    whole = Whole(**_named(given, {"align": "alignment", "rpe": "step"}))
    late = _named(given, {"bad": "bad_state", "period": "period"})
    return {"dynamics": Dynamics(**mine, **both, whole=whole), "delay": DelayAxis(**late, **both)}


def _named(given: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    return {own: given[name] for name, own in names.items() if name in given}


def _horizons(text: str) -> WindowPlan:
    """Windows begin every half of the shortest horizon."""
    horizons = tuple(_number(word, "seconds, as 0.5,1,2") for word in text.split(","))
    if not all(0 < horizon <= 3600 for horizon in horizons):
        raise RequestError("give seconds over 0, up to 3600")
    return WindowPlan(horizons, stride=0.5 * horizons[0])


def _nrmse(text: str) -> str:
    return _one_of(text, tuple(SCALES))


def _bad(text: str) -> str:
    return _one_of(text, BAD_STATES)


def _one_of(text: str, known: Sequence[str]) -> str:
    if text not in known:
        raise RequestError(f"give one of {', '.join(known)}")
    return text


def _align(text: str) -> LogAlignment:
    parts = [] if text == "none" else text.split("+")
    known = set(parts) <= set(_PARTS) and len(set(parts)) == len(parts)
    if not known or (parts and "rigid" not in parts):
        raise RequestError("give none, rigid, or rigid with +reflection, +scale or both")
    return LogAlignment(*(part in parts for part in _PARTS))


def _rpe(text: str) -> Step:
    told = "seconds, as 1s, or poses, as 25"
    if text.endswith("s"):
        return Step(seconds=_between(text[:-1], 0.0, 3600.0, told))
    poses = _between(text, 0.0, 1e9, told)
    if poses != int(poses):
        raise RequestError(f"give {told}")
    return Step(poses=int(poses))


def _reach(text: str) -> float:
    return _between(text, 0.0, MOST_REACH, f"seconds up to {MOST_REACH:g}, as 0.5")


def _period(text: str) -> float:
    return _between(text, 0.0, 60.0, "seconds, as 0.05")


def _noise(text: str) -> Noise | None:
    if text == "measured":
        return None
    told = "measured, or metres and radians, as 0.002,0.003"
    values = [_number(word, told) for word in text.split(",")]
    if len(values) != 2 or min(values) < 0:
        raise RequestError(f"give {told}")
    return Noise(*values)


def _number(text: str, told: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RequestError(f"give {told}")
    return value


def _between(text: str, low: float, high: float, told: str) -> float:
    value = _number(text, told)
    if not low < value <= high:
        raise RequestError(f"give {told}")
    return value


OPTIONS: dict[str, Callable[[str], Any]] = {
    "horizons": _horizons,
    "nrmse": _nrmse,
    "align": _align,
    "rpe": _rpe,
    "reach": _reach,
    "bad": _bad,
    "period": _period,
    "noise": _noise,
}
