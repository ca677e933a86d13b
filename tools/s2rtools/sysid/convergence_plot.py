"""Plot of the convergence of the searches, as PNG."""

from __future__ import annotations

import io
from collections.abc import Sequence

from s2rtools.sysid.search import SearchTrace

_INK, _GRID = "#22262b", "#d9dde2"
_COLOURS = ("#1f6fb2", "#c0392b", "#6f8f1f", "#8a5aa8", "#c77f17")
_NESTED = 3
"""Number of searches whose end markers are nested, so that equal ends stay visible."""


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
