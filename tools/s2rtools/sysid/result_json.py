"""An identification as plain JSON data."""

from __future__ import annotations

from typing import Any

from s2rtools.sysid.identify import Identification
from s2rtools.sysid.model_mismatch import Structure


def record(found: Identification) -> dict[str, Any]:
    """All of it, with six significant digits."""
    settings, known = found.settings, found.identifiability
    sigma = found.problem.sigma
    return {
        "simulator": found.space.simulator.name,
        "lumped": found.space.lumped,
        "estimates": _estimates(found),
        "fixed": {name: _short(value) for name, value in sorted(found.space.fixed.items())},
        "level": settings.level,
        "replicates": settings.replicates,
        "window": settings.window,
        "seed": settings.seed,
        "drives": {"fitted": list(found.fitted), "held_out": list(found.held_out)},
        "noise": {"place": _short(sigma[0]), "heading": _short(sigma[2])},
        "searches": [
            {
                "seed": course.seed,
                "evaluations": int(course.evaluations[-1]),
                "cost": _short(course.cost),
            }
            for course in found.courses
        ],
        "held_out": found.error.record(),
        "identifiability": {
            "eigenvalues": [_short(value) for value in known.eigenvalues],
            "condition": _short(known.condition),
            "open": list(known.open_names),
        },
        "structure": _structure(found.structure),
        "at_ends": list(found.at_ends),
        "ranges": {
            one.name: [_short(one.low), _short(one.high), one.scale]
            for one in found.space.parameters
        },
        "warnings": list(found.warnings),
        "conclusive": found.conclusive,
    }


def _estimates(found: Identification) -> dict[str, Any]:
    return {
        one.name: {
            "unit": one.unit,
            "untuned": _short(one.untuned),
            "value": _short(one.value),
            "low": _short(one.low),
            "high": _short(one.high),
            "identified": not one.open,
        }
        for one in found.estimates
    }


def _structure(shape: Structure) -> dict[str, Any]:
    return {
        "mismatch": shape.mismatch,
        "residuals": [
            {
                "channel": one.name,
                "autocorrelation": _short(one.autocorrelation),
                "limit": _short(one.limit),
                "rms": _short(one.rms),
                "systematic": one.systematic,
            }
            for one in shape.channels
        ],
        "candidates": [
            {
                "parameter": one.name,
                "nominal": _short(one.nominal),
                "estimate": _short(one.estimate),
                "low": _short(one.low),
                "high": _short(one.high),
                "differs": one.differs,
            }
            for one in shape.candidates
        ],
    }


def _short(value: float) -> float:
    return float(f"{float(value):.6g}")
