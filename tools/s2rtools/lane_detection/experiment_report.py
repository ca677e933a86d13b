"""Results of the threshold experiment as a JSON document, CSV rows, a table, words and a figure."""

from __future__ import annotations

import csv
import io
import json
import math
from typing import Any

import numpy as np

from s2rstore.metrics.bootstrap import LEVEL_TEXT, Interval
from s2rtools.lane_detection.line_detector import COLOURS
from s2rtools.lane_detection.line_scores import mean_f1, precision_recall
from s2rtools.lane_detection.threshold_experiment import (
    BASELINE,
    ORACLE,
    SIM_TUNED,
    Experiment,
    verdict,
)

SCHEMA = 1
_BEST_SHOWN = 8
_CSV = (
    "arm", "label_free", "group", "colour", "f1", "f1_low", "f1_high", "difference_to_default_ai",
    "difference_low", "difference_high", "gap_closed", "segment_precision", "segment_recall",
    "invented_per_image", "offset_error_m", "heading_error_rad", "ms_per_frame", "seed_spread",
)  # fmt: skip


def to_document(experiment: Experiment) -> dict[str, Any]:
    """All results as JSON values; unknown numbers are null."""
    rows = [
        _row(experiment, name, group, colour)
        for group in experiment.groups
        for name in experiment.scores
        for colour in (None, *COLOURS)
    ]
    verdicts = [
        verdict(experiment, group, colour)
        for group in experiment.groups
        for colour in (None, *COLOURS)
    ]
    document = {
        "schema": SCHEMA, **experiment.facts, "chosen": experiment.chosen,
        "choice": experiment.choice.candidates,
        "groups": {name: len(rows) for name, rows in experiment.groups.items()},
        "verdicts": verdicts, "arms": rows, "skipped": experiment.skipped,
        "words": in_words(experiment),
    }  # fmt: skip
    finite: dict[str, Any] = _finite(document)
    return finite


def _row(experiment: Experiment, name: str, group: str, colour: str | None) -> dict[str, Any]:
    scores, rows = experiment.scores[name], experiment.groups[group]
    of = experiment.f1(name, group, colour)
    change = experiment.difference(name, BASELINE, group, colour)
    segments = scores.segments[rows].sum(axis=0)
    chosen = segments.sum(axis=0) if colour is None else segments[COLOURS.index(colour)]
    known = bool(chosen[3] > 0)
    precision, recall = precision_recall(chosen)
    pose = scores.pose[rows]
    offset, heading = (
        np.median(pose[:, axis][~np.isnan(pose[:, axis])])
        if np.isfinite(pose[:, axis]).any() else math.nan
        for axis in (0, 1)
    )  # fmt: skip
    values = (
        name, scores.label_free, group, colour or "all", of.value, of.low, of.high, change.value,
        change.low, change.high,
        experiment.gap_closed(name, group) if colour is None else math.nan,
        float(precision) if known else math.nan, float(recall) if known else math.nan,
        chosen[4] / len(rows) if known else math.nan, offset, heading, scores.milliseconds,
        _seed_spread(scores.by_seed),
    )  # fmt: skip
    return dict(zip(_CSV, values, strict=True))


def _seed_spread(by_seed: list[Any]) -> float:
    """Largest minus smallest F1 over all judged images between seeds."""
    if len(by_seed) < 2:
        return math.nan
    return float(np.ptp([mean_f1(counts) for counts in by_seed]))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def to_csv(document: dict[str, Any]) -> str:
    """The rows of a document, one per arm, group and colour."""
    text = io.StringIO()
    writer = csv.DictWriter(text, _CSV, lineterminator="\n")
    writer.writeheader()
    writer.writerows(document["arms"])
    return text.getvalue()


def shown_arms(experiment: Experiment) -> list[str]:
    """Arms of the table and the figure: baselines, the chosen one, the best label-free ones, and
    those with labels."""
    names = experiment.scores
    free = sorted(
        (name for name, scores in names.items() if scores.label_free),
        key=lambda name: -np.nan_to_num(experiment.f1(name, "all").value),
    )
    first = ["default", BASELINE, SIM_TUNED, "sim+ai", experiment.chosen]
    labelled = [name for name, scores in names.items() if not scores.label_free]
    return list(dict.fromkeys([*first, *free[:_BEST_SHOWN], *labelled]))


def to_table(experiment: Experiment) -> str:
    """A table per group: F1 and intervals, differences, gap closed, segments, pose, time."""
    lines = []
    for group, rows in experiment.groups.items():
        blocks = experiment.blocks(group).unit_count
        lines.append(f"\n{group}: {len(rows)} images, {blocks} independent blocks")
        lines.append(
            f"{'arm':<44} {'F1 (' + LEVEL_TEXT + ')':<19} {'to default+ai':<22} "
            f"{'gap':>5} {'prec.':>5} {'rec.':>5} {'inv.':>5} {'pose':>11} {'ms':>5}"
        )
        lines += [_line(experiment, name, group) for name in shown_arms(experiment)]
    lines.append(
        "\ngap: share of the gap from simulation-tuned to per-light oracle thresholds that is "
        "closed; prec., rec.: of segments; inv.: invented segments per image; pose: median error "
        "in mm and degrees; *: chosen without labels"
    )
    return "\n".join(lines).lstrip("\n")


def _line(experiment: Experiment, name: str, group: str) -> str:
    row = _row(experiment, name, group, None)
    mark = "*" if name == experiment.chosen else " "
    of = Interval(row["f1_low"], row["f1"], row["f1_high"])
    change = Interval(row["difference_low"], row["difference_to_default_ai"],
                      row["difference_high"])  # fmt: skip
    pose = "-"
    if math.isfinite(row["offset_error_m"]):
        pose = f"{1000 * row['offset_error_m']:.0f} {math.degrees(row['heading_error_rad']):.1f}"
    return (
        f"{mark}{name[:43]:<43} {_interval(of):<19} {_interval(change, '+'):<22} "
        f"{_number(row['gap_closed']):>5} {_number(row['segment_precision']):>5} "
        f"{_number(row['segment_recall']):>5} {_number(row['invented_per_image'], 1):>5} "
        f"{pose:>11} {_number(row['ms_per_frame'], 1):>5}"
    )


def _number(value: float, digits: int = 2) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def _interval(of: Interval, sign: str = "") -> str:
    if not math.isfinite(of.value):
        return "-"
    bounds = f" [{of.low:{sign}.2f}, {of.high:{sign}.2f}]" if math.isfinite(of.low) else ""
    return f"{of.value:{sign}.2f}{bounds}"


def in_words(experiment: Experiment) -> str:
    """The answer as sentences, one per group and colour."""
    sentences = [
        f"Chosen without labels, on simulated lights: {experiment.chosen}.",
    ]
    for group in experiment.groups:
        of = verdict(experiment, group)
        if of["spared"] is None:
            sentences.append(f"{group}: too few recordings for an interval.")
            continue
        f1, oracle = f"{of['f1']:.2f} [{of['low']:.2f}, {of['high']:.2f}]", f"{of['oracle']:.2f}"
        answer = "calibration spared" if of["spared"] else "calibration needed"
        change = experiment.difference(experiment.chosen, BASELINE, group)
        sentence = (
            f"{group}: {answer}; mean F1 {f1} without labels, {oracle} with thresholds tuned on "
            f"these images, {_interval(change, '+')} to the default thresholds with anti-instagram."
        )
        if of["labels_that_win"]:
            sentence += f" Calibration wins from {of['labels_that_win']} labelled images per light."
        else:
            sentence += " No tested number of labelled images is better by more than its interval."
        colours = [
            f"{colour} {'spared' if each['spared'] else 'needed'}"
            for colour in COLOURS
            if (each := verdict(experiment, group, colour))["spared"] is not None
        ]
        sentences.append(f"{sentence} By colour: {', '.join(colours)}.")
    return "\n".join(sentences)


def figure_png(experiment: Experiment) -> bytes:
    """F1 with intervals of the shown arms, a panel per group of lights."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    groups = [name for name in experiment.groups if name.endswith("lights")] or ["all"]
    names = shown_arms(experiment)[::-1]
    figure = Figure(figsize=(3.2 + 3.4 * len(groups), 1.4 + 0.26 * len(names)))
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(groups), sharey=True, squeeze=False)[0]
    for axis, group in zip(axes, groups, strict=True):
        for place, name in enumerate(names):
            of = experiment.f1(name, group)
            free = experiment.scores[name].label_free
            colour = "#0072b2" if free else "#d55e00"
            shape = "D" if name == experiment.chosen else "o"
            if math.isfinite(of.low):
                axis.plot([of.low, of.high], [place, place], color=colour, linewidth=1.5)
            axis.plot(of.value, place, shape, color=colour, markersize=5)
        axis.axvline(
            experiment.f1(ORACLE, group).value, color="#999999", linewidth=1, dashes=(4, 2)
        )
        axis.set_title(f"{group} ({len(experiment.groups[group])} images)", fontsize=9)
        axis.set_xlim(-0.02, 1.02)
        axis.set_xlabel(f"mean pixel F1, {LEVEL_TEXT} interval", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.grid(axis="x", linewidth=0.4, alpha=0.5)
    axes[0].set_yticks(range(len(names)), names)
    figure.suptitle(
        "Thresholds without labels (blue; diamond: chosen) and with labels (orange); "
        "dashed: oracle per light", fontsize=9,
    )  # fmt: skip
    figure.tight_layout()
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=130, metadata={"Software": None})
    return content.getvalue()


def to_json(document: dict[str, Any]) -> str:
    """The document as JSON text."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"
