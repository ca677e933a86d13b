"""The searches' convergence as PNG."""

from __future__ import annotations

import io
from collections.abc import Sequence

from s2rtools.sysid.search import Course

_INK, _GRID, _COLOURS = (
    "#22262b",
    "#d9dde2",
    ("#1f6fb2", "#c0392b", "#6f8f1f", "#8a5aa8", "#c77f17"),
)
_NESTED = 3
"""Searches whose ends stay apart where they are equal, one diamond inside the other."""


def convergence_figure(courses: Sequence[Course], title: str) -> bytes:
    """Best cost against evaluations, one line per seed; one input gives the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), dpi=150, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for course in courses:
        colour = _COLOURS[course.seed % len(_COLOURS)]
        style = ("-", "--", ":", "-.")[course.seed % 4]
        axes.plot(course.evaluations, course.costs, style, color=colour, linewidth=1.6,
                  label=f"search {course.seed + 1}")  # fmt: skip
        inside = min(course.seed, _NESTED)
        axes.plot(course.evaluations[-1:], [course.cost], "D", color=colour, fillstyle="none",
                  markersize=4 + 3 * (_NESTED - inside), markeredgewidth=1.4)  # fmt: skip
    axes.plot([], [], "D", color=_INK, fillstyle="none", markersize=7, linestyle="none",
              label="after least squares")  # fmt: skip
    axes.axhline(1.0, color=_INK, linewidth=0.8, linestyle=(0, (1, 2)))
    axes.annotate("noise of the sensors", (0.01, 1.0), (0, 3), xycoords=("axes fraction", "data"),
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
