"""Figure of a front: gain against the number of changes, as PNG, SVG or PDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from s2rtools.suggestions.answers import SuggestReport

_INK, _GRID, _MUTED = "#22262b", "#d9dde2", "#8a9099"
_COLOURS = {"real": "#c0392b", "sim": "#1f6fb2"}
_FORMATS = ("png", "svg", "pdf")


def is_figure(path: Path) -> bool:
    """Whether a figure can be written in the format that the name of the file ends in."""
    return path.suffix.removeprefix(".").lower() in _FORMATS


def write_front(report: SuggestReport, path: Path) -> None:
    """Draw each answer with its interval on held-out instances, beside its gain on the fit."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.4), dpi=150, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    scale = 1.0 if report.side == "real" else 100.0
    colour = _COLOURS[report.side]
    axes.axhline(0, color=_INK, linewidth=0.8)
    sizes = [len(answer.changes) for answer in report.answers]
    fitted = [scale * answer.fitted for answer in report.answers]
    axes.plot([0, *sizes], [0.0, *fitted], "--", color=_MUTED, linewidth=1.2, marker=".",
              label="on the instances of the fit")  # fmt: skip
    for place, (size, answer) in enumerate(zip(sizes, report.answers, strict=True)):
        gain = answer.gain
        bounds = np.array([[gain.value - gain.low], [gain.high - gain.value]]) * scale
        axes.errorbar(
            [size], [scale * gain.value], yerr=np.nan_to_num(bounds), color=colour, fmt="o",
            markersize=9 if place == report.best else 6, capsize=4, linewidth=1.4,
            markerfacecolor=colour if answer.evident else "white",
            label="on held-out instances, with interval" if place == 0 else None,
        )  # fmt: skip
        text = "\n".join(f"{change.name}={change.value:g}" for change in answer.changes)
        axes.annotate(text, (size, scale * gain.value), (8, -4), textcoords="offset points",
                      va="top", fontsize=7.5, color=_INK,
                      bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})  # fmt: skip
    if not report.answers:
        axes.text(0.5, 0.6, "nothing helps", ha="center", transform=axes.transAxes, color=_INK)
    axes.set_xlim(-0.2, max(sizes, default=1) + 0.9)
    axes.set_xticks(range(max(sizes, default=1) + 1))
    axes.set_xlabel("number of changes", color=_INK)
    unit = "decrease of the mean real error (m)"
    axes.set_ylabel(unit if report.side == "real" else "decrease of the mismatch (%)", color=_INK)
    aim = "changes of real images" if report.side == "real" else "changes of the simulator"
    axes.set_title(f"{report.run}: {aim}", loc="left", fontsize=11, color=_INK, parse_math=False)
    axes.grid(color=_GRID, linewidth=0.6)
    axes.tick_params(colors=_INK)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=2)
    kind = path.suffix.removeprefix(".").lower()
    metadata = {"Software": None} if kind == "png" else {"Date": None} if kind == "svg" else {}
    figure.savefig(path, format=kind, metadata=metadata)
