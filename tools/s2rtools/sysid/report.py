"""Files of an identification: JSON, a table, the convergence plot and the residual network."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rtools.sysid.convergence_plot import convergence_figure
from s2rtools.sysid.identify import Identification
from s2rtools.sysid.model_mismatch import Structure
from s2rtools.sysid.residual_training import Residual

RESULT, TABLE, PICTURE, NETWORK = (
    "sysid.json",
    "sysid.txt",
    "convergence.png",
    "residual.safetensors",
)


def result_json(found: Identification, residual: Residual | None) -> dict[str, Any]:
    """The content of `sysid.json`."""
    content = record(found)
    if residual is not None:
        content["residual"] = residual.record()
    return content


def write(folder: Path, found: Identification, residual: Residual | None) -> dict[str, Any]:
    """Write all files into `folder`, the JSON last, each atomically; return its content.

    The residual network is written only if it helped. Raises RequestError on failure.
    """
    content = result_json(found, residual)
    title = f"Identification of {content['simulator']} from {len(found.fitted)} drives"
    files = {
        PICTURE: convergence_figure(found.traces, title),
        TABLE: table(content).encode(),
    }
    if residual is not None and residual.accepted:
        files[NETWORK] = residual.weights
    files[RESULT] = (json.dumps(content, indent=1) + "\n").encode()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if NETWORK not in files:
            (folder / NETWORK).unlink(missing_ok=True)
        for name, data in files.items():
            atomic_writes.write_file(folder / name, data)
    except OSError as error:
        raise RequestError(f"{folder}: cannot be written ({error.strerror})") from error
    return content


def check_writable(folder: Path) -> None:
    """Raises RequestError where results could not be written, before the work."""
    if folder.exists() and not folder.is_dir():
        raise RequestError(f"{folder}: is a file; give a folder with --out")
    near = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not os.access(near, os.W_OK | os.X_OK):
        raise RequestError(f"{folder}: cannot be written; give another folder with --out")


def table(content: dict[str, Any]) -> str:
    """A text table of estimates, held-out errors and warnings."""
    level = f"{100 * content['level']:.0f} %"
    rows = [("parameter", "untuned", "estimate", f"{level} interval", "unit")]
    for name, one in content["estimates"].items():
        limits = f"{one['low']:.5g} .. {one['high']:.5g}" if one["identified"] else "not determined"
        rows.append((name, f"{one['untuned']:.4g}", f"{one['value']:.5g}", limits, one["unit"]))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()
             for row in rows]  # fmt: skip
    lines.insert(1, "  ".join("-" * width for width in widths))
    held = content["held_out"]
    lines += ["", *(
        f"prediction error on held-out windows, {kind} parameters: "
        f"{100 * held[kind]['place_m']:.2f} cm, "
        f"{57.29578 * held[kind]['heading_rad']:.2f} degrees"
        for kind in ("untuned", "fitted")
    )]  # fmt: skip
    if "residual" in content:
        lines += ["", content["residual"]["sentence"]]
    lines += (
        ["", *(f"warning: {line}" for line in content["warnings"])] if content["warnings"] else []
    )
    return "\n".join(lines) + "\n"


def record(found: Identification) -> dict[str, Any]:
    """The identification as JSON data, with six significant digits."""
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
                "seed": trace.seed,
                "evaluations": int(trace.evaluations[-1]),
                "cost": _short(trace.cost),
            }
            for trace in found.traces
        ],
        "held_out": found.error.record(),
        "identifiability": {
            "eigenvalues": [_short(value) for value in known.eigenvalues],
            "condition": _short(known.condition),
            "open": list(known.undetermined),
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
