"""Files of an identification: JSON, a table, the convergence plot and the residual network."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from s2rstore.errors import RequestError
from s2rstore.intervals import LEVEL
from s2rtools.common.command_line import output
from s2rtools.common.result_files import write_all
from s2rtools.sysid.identify import Identification, SearchTrace

if TYPE_CHECKING:
    from s2rtools.sysid.residual_network import Residual

RESULT, TABLE, PICTURE = "sysid.json", "sysid.txt", "convergence.png"
NETWORK = "residual.safetensors"
_INK, _GRID = "#22262b", "#d9dde2"
_COLOURS = ("#1f6fb2", "#c0392b", "#6f8f1f", "#8a5aa8", "#c77f17")
_NESTED = 3
"""Number of searches whose end markers are nested, so that equal ends stay visible."""


def write(folder: Path, result: Identification, residual: Residual | None) -> dict[str, Any]:
    """Write all files into `folder`, or none; return the content of the JSON.

    The residual network is written only if it helps. Raises RequestError on failure.
    """
    content = record(result, residual)
    title = f"Identification of {content['simulator']} from {len(result.fitted)} drives"
    files = {PICTURE: convergence_figure(result.traces, title), TABLE: table(content).encode()}
    if residual is not None and residual.accepted:
        files[NETWORK] = residual.weights
    files[RESULT] = (json.dumps(content, indent=1) + "\n").encode()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if NETWORK not in files:
            (folder / NETWORK).unlink(missing_ok=True)
    except OSError as error:
        raise RequestError(f"{folder}: cannot be written ({error.strerror})") from error
    write_all({folder / name: data for name, data in files.items()})
    return content


def table(content: dict[str, Any]) -> str:
    """A text table of estimates, held-out errors and warnings."""
    level = f"{100 * content['level']:.0f} %"
    rows = []
    for name, one in content["estimates"].items():
        limits = f"{one['low']:.5g} .. {one['high']:.5g}" if one["identified"] else "not determined"
        rows.append((name, f"{one['untuned']:.4g}", f"{one['value']:.5g}", limits, one["unit"]))
    names = ("parameter", "untuned", "estimate", f"{level} interval", "unit")
    lines = [output.table(names, rows)]
    held = content["held_out"]
    lines += [*(
        f"prediction error on held-out windows, {kind} parameters: "
        f"{100 * held[kind]['place_m']:.2f} cm, "
        f"{57.29578 * held[kind]['heading_rad']:.2f} degrees"
        for kind in ("untuned", "fitted")
    )]  # fmt: skip
    if "residual" in content:
        lines += ["", content["residual"]["sentence"]]
    if content["warnings"]:
        lines += ["", *(f"warning: {line}" for line in content["warnings"])]
    return "\n".join(lines) + "\n"


def record(result: Identification, residual: Residual | None = None) -> dict[str, Any]:
    """The content of `sysid.json`, with six significant digits."""
    settings, known, structure = result.settings, result.identifiability, result.structure
    sigma = result.problem.sigma
    return {
        "simulator": result.space.simulator.name,
        "lumped": result.space.lumped,
        "estimates": {
            one.name: {
                "unit": one.unit,
                **_shorten(one, "untuned", "value", "low", "high"),
                "identified": not one.open,
            }
            for one in result.estimates
        },
        "fixed": {name: _short(value) for name, value in sorted(result.space.fixed.items())},
        "level": LEVEL,
        "window": settings.window,
        "seed": settings.seed,
        "drives": {"fitted": list(result.fitted), "held_out": list(result.held_out)},
        "noise": {"place": _short(sigma[0]), "heading": _short(sigma[2])},
        "searches": [
            {
                "seed": trace.seed,
                "evaluations": int(trace.evaluations[-1]),
                "cost": _short(trace.cost),
            }
            for trace in result.traces
        ],
        "held_out": result.error.record(),
        "identifiability": {
            "eigenvalues": [_short(value) for value in known.eigenvalues],
            "condition": _short(known.condition),
            "open": list(known.undetermined),
        },
        "structure": {
            "mismatch": structure.mismatch,
            "residuals": [
                {
                    "channel": one.name,
                    **_shorten(one, "autocorrelation", "limit", "rms"),
                    "systematic": one.systematic,
                }
                for one in structure.channels
            ],
            "candidates": [
                {
                    "parameter": one.name,
                    **_shorten(one, "nominal", "estimate", "low", "high"),
                    "differs": one.differs,
                }
                for one in structure.candidates
            ],
        },
        "at_ends": list(result.at_ends),
        "ranges": {
            one.name: [_short(one.low), _short(one.high), one.scale]
            for one in result.space.parameters
        },
        "warnings": list(result.warnings),
        "conclusive": result.conclusive,
        **({} if residual is None else {"residual": residual.record()}),
    }


def _shorten(one: object, *names: str) -> dict[str, float]:
    return {name: _short(getattr(one, name)) for name in names}


def _short(value: float) -> float:
    return float(f"{float(value):.6g}")


def convergence_figure(traces: Sequence[SearchTrace], title: str) -> bytes:
    """Best cost against evaluations, one line per seed; deterministic."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), dpi=150, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for trace in traces:
        colour = _COLOURS[trace.seed % len(_COLOURS)]
        style = ("-", "--", ":", "-.")[trace.seed % 4]
        axes.plot(trace.evaluations, trace.costs, style, color=colour, linewidth=1.6,
                  label=f"search {trace.seed + 1}")  # fmt: skip
        inside = min(trace.seed, _NESTED)
        axes.plot(trace.evaluations[-1:], [trace.cost], "D", color=colour, fillstyle="none",
                  markersize=4 + 3 * (_NESTED - inside), markeredgewidth=1.4)  # fmt: skip
    axes.plot([], [], "D", color=_INK, fillstyle="none", markersize=7, linestyle="none",
              label="after least squares")  # fmt: skip
    axes.axhline(1.0, color=_INK, linewidth=0.8, linestyle=(0, (1, 2)))
    axes.annotate("sensor noise", (0.01, 1.0), (0, 3), xycoords=("axes fraction", "data"),
                  textcoords="offset points", ha="left", fontsize=8, color=_INK)  # fmt: skip
    axes.set_yscale("log")
    axes.set_xlim(left=0)
    axes.set_xlabel("evaluations of the objective", color=_INK)
    axes.set_ylabel("mean square residual / noise variance", color=_INK)
    axes.set_title(title, loc="left", fontsize=11, color=_INK, parse_math=False)
    axes.grid(color=_GRID, linewidth=0.6)
    axes.tick_params(colors=_INK)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()
