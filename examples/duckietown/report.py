"""Results of the threshold study as a JSON document, CSV rows, a table, words and a figure."""

from __future__ import annotations

import csv
import io
import json
import math
from typing import Any

import numpy as np

from examples.duckietown.line_detector import COLOURS
from examples.duckietown.line_scores import false_pixels_of_absent, mean_f1, precision_recall
from examples.duckietown.study import (
    BASELINE,
    HARD_BELOW,
    ORACLE,
    SIM_TUNED,
    Study,
    verdict,
)
from s2rstore.intervals import LEVEL_TEXT, Interval
from s2rtools.common.blocks import MIN_TRAJECTORIES

SCHEMA = 2
_BEST_SHOWN = 8
_ABSENT = "false_pixels_of_absent_colours_per_image"
_WITHIN = ", intervals within it, not between recordings"
_CSV = (
    "variant", "label_free", "group", "colour", "f1", "f1_low", "f1_high",
    "difference_to_default_ai", "difference_low", "difference_high", "gap_closed",
    "false_pixels_of_absent_colours_per_image",
    "segment_precision", "segment_recall", "invented_per_image", "offset_error_m",
    "heading_error_rad", "ms_per_frame", "seed_spread",
)  # fmt: skip


def to_document(study: Study) -> dict[str, Any]:
    """All results as JSON values; unknown numbers are null."""
    rows = [
        _row(study, name, group, colour)
        for group in study.groups
        for name in study.scores
        for colour in (None, *COLOURS)
    ]
    verdicts = [
        verdict(study, group, colour) for group in study.groups for colour in (None, *COLOURS)
    ]
    document = {
        "schema": SCHEMA, **study.facts, "chosen": study.chosen,
        "choice": study.choice.candidates,
        "groups": {name: len(rows) for name, rows in study.groups.items()},
        "units": {name: study.unit(name) for name in study.groups},
        "true_colours": {name: _true_colours(study, name) for name in study.groups},
        "verdicts": verdicts, "variants": rows, "skipped": study.skipped,
        "words": in_words(study),
    }  # fmt: skip
    finite: dict[str, Any] = _finite(document)
    return finite


def _true_colours(study: Study, group: str) -> list[str]:
    present = study.true_colours(group)
    return [colour for colour, known in zip(COLOURS, present, strict=True) if known]


def _row(study: Study, name: str, group: str, colour: str | None) -> dict[str, Any]:
    scores, rows = study.scores[name], study.groups[group]
    of = study.f1(name, group, colour)
    change = study.difference(name, BASELINE, group, colour)
    segments = scores.segments[rows].sum(axis=0)
    chosen = segments.sum(axis=0) if colour is None else segments[COLOURS.index(colour)]
    known = bool(chosen[3] > 0)
    counts, present = study.counts(name, group), study.true_colours(group)
    asked = np.ones(len(COLOURS), np.bool_) if colour is None else np.array(COLOURS) == colour
    absent = false_pixels_of_absent(counts[asked], present[asked]) / len(rows)
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
        study.gap_closed(name, group) if colour is None else math.nan, absent,
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
    """The rows of a document, one per variant, group and colour."""
    text = io.StringIO()
    writer = csv.DictWriter(text, _CSV, lineterminator="\n")
    writer.writeheader()
    writer.writerows(document["variants"])
    return text.getvalue()


def shown_variants(study: Study) -> list[str]:
    """Variants of the table and the figure: baselines, the chosen one, the best label-free ones,
    and those with labels."""
    names = study.scores
    free = sorted(
        (name for name, scores in names.items() if scores.label_free),
        key=lambda name: -np.nan_to_num(study.f1(name, "all").value),
    )
    first = ["default", BASELINE, SIM_TUNED, "sim+ai", study.chosen]
    labelled = [name for name, scores in names.items() if not scores.label_free]
    return list(dict.fromkeys([*first, *free[:_BEST_SHOWN], *labelled]))


def to_table(study: Study) -> str:
    """A table per group: F1 and intervals, differences, gap closed, segments, pose, time."""
    lines = []
    for group, rows in study.groups.items():
        colours = ", ".join(_true_colours(study, group))
        lines.append(
            f"\n{group}: {len(rows)} images; lines: {colours}; resampled: {study.unit(group)}"
            f"{_WITHIN if study.recordings(group) < 2 else ''}"
        )
        lines.append(
            f"{'variant':<44} {'F1 (' + LEVEL_TEXT + ')':<19} {'to default+ai':<22} "
            f"{'gap':>5} {'abs.':>5} {'prec.':>5} {'rec.':>5} {'inv.':>5} {'pose':>11} {'ms':>5}"
        )
        lines += [_line(study, name, group) for name in shown_variants(study)]
    lines.append(
        "\nF1: mean over the colours that have true lines in the group; gap: share of the gap from "
        "simulation-tuned to per-light oracle thresholds that is closed; abs.: false pixels per "
        "image of colours without true lines in the group; prec., rec.: of segments; inv.: "
        "invented segments per image; pose: median error in mm and degrees; *: chosen "
        "without labels"
    )
    return "\n".join(lines).lstrip("\n")


def _line(study: Study, name: str, group: str) -> str:
    row = _row(study, name, group, None)
    mark = "*" if name == study.chosen else " "
    of = Interval(row["f1_low"], row["f1"], row["f1_high"])
    change = Interval(row["difference_low"], row["difference_to_default_ai"],
                      row["difference_high"])  # fmt: skip
    pose = "-"
    if math.isfinite(row["offset_error_m"]):
        pose = f"{1000 * row['offset_error_m']:.0f} {math.degrees(row['heading_error_rad']):.1f}"
    return (
        f"{mark}{name[:43]:<43} {_interval(of):<19} {_interval(change, '+'):<22} "
        f"{_number(row['gap_closed']):>5} "
        f"{_number(row[_ABSENT], 1):>5} {_number(row['segment_precision']):>5} "
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


def in_words(study: Study) -> str:
    """The answer as sentences, one per group, and what limits it."""
    sentences = [f"Chosen without labels, on simulated lights: {study.chosen}."]
    plain = study.facts["lights_with_plausible_detections"]
    if study.choice.variant.guarded and plain:
        sentences.append(
            f"In {', '.join(plain)} {BASELINE} detects a plausible amount of white and yellow, so "
            "nothing is translated there."
        )
    sentences += [_answer(study, group) for group in study.groups]
    return "\n".join(sentences + _limits(study))


def _answer(study: Study, group: str) -> str:
    of = verdict(study, group)
    f1 = _interval(Interval(of["low"], of["f1"], of["high"]))
    with_labels = f"{of['oracle']:.2f} with thresholds tuned on these images"
    change = _interval(study.difference(study.chosen, BASELINE, group), "+")
    if of["recordings"] < 2:
        return (
            f"{group}: one recording: no interval between recordings, no verdict; mean F1 {f1} "
            f"(interval within the recording) without labels, {with_labels}."
        )
    if of["spared"] is None:
        return f"{group}: no interval, no verdict; mean F1 {f1} without labels, {with_labels}."
    sentence = (
        f"{group}: calibration {'spared' if of['spared'] else 'needed'}; mean F1 {f1} without "
        f"labels, {with_labels}, {change} to the default thresholds with anti-instagram; intervals "
        f"from {of['unit']}."
    )
    if of["labels_that_win"]:
        sentence += f" Calibration wins from {of['labels_that_win']} labelled images per light."
    elif of["labels_tested"]:
        tested = ", ".join(str(count) for count in of["labels_tested"])
        sentence += f" Of {tested} labelled images per light, none is better beyond its interval."
    else:
        sentence += " No number of labelled images was tested: too few are labelled."
    colours = [
        f"{colour} {'spared' if each['spared'] else 'needed'}"
        for colour in COLOURS
        if (each := verdict(study, group, colour))["spared"] is not None
    ]
    return f"{sentence} By colour: {', '.join(colours)}."


def _limits(study: Study) -> list[str]:
    """Sentences about what the intervals and groups do not cover."""
    facts, sentences = study.facts, []
    shared, same = facts["fitted_on_judged_recordings"], facts["fitted_on_judged_images"]
    if shared:
        sentences.append(
            f"Translators of one light and of all lights are fitted on images of the judged "
            f"recordings, without labels, in {', '.join(shared)}: in other recordings they may be "
            "worse."
        )
    if same:
        sentences.append(f"They are fitted on the judged images themselves in {', '.join(same)}.")
    if "hard lights" in study.groups:
        sentences.append(
            f"Hard lights are those in which {BASELINE} stays below {HARD_BELOW:g} on the judged "
            f"images: there the difference to {BASELINE} is stated too high, in ordinary lights "
            "too low."
        )
    several = [group for group in study.groups if study.recordings(group) > 1]
    if not all(study.blocks(group).by_trajectory for group in several):
        sentences.append(
            f"Below {MIN_TRAJECTORIES} recordings pieces of them are the units: such intervals are "
            "too narrow where recordings differ."
        )
    if any(len(scores.by_seed) > 1 for scores in study.scores.values()):
        sentences.append(
            "Intervals hold the fits of learned methods and the draws of labelled images fixed; "
            "the spread between them stands apart, as seed_spread."
        )
    return sentences


def figure_png(study: Study) -> bytes:
    """F1 with intervals of the shown variants, a panel per group of lights."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    groups = [name for name in study.groups if name.endswith("lights")] or ["all"]
    names = shown_variants(study)[::-1]
    figure = Figure(figsize=(3.2 + 3.4 * len(groups), 1.4 + 0.26 * len(names)))
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(groups), sharey=True, squeeze=False)[0]
    for axis, group in zip(axes, groups, strict=True):
        for place, name in enumerate(names):
            of = study.f1(name, group)
            free = study.scores[name].label_free
            colour = "#0072b2" if free else "#d55e00"
            shape = "D" if name == study.chosen else "o"
            if math.isfinite(of.low):
                axis.plot([of.low, of.high], [place, place], color=colour, linewidth=1.5)
            axis.plot(of.value, place, shape, color=colour, markersize=5)
        axis.axvline(study.f1(ORACLE, group).value, color="#999999", linewidth=1, dashes=(4, 2))
        axis.set_title(
            f"{group} ({len(study.groups[group])} images; {study.unit(group)})",
            fontsize=9,
        )
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
