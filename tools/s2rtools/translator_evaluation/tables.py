"""The text of reports of translators: verdicts, content, distances, task."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from s2rstore.intervals import LEVEL_TEXT
from s2rtools.common.command_line import output
from s2rtools.translator_evaluation.measures import (
    CONTENT,
    COVERAGE,
    DISTANCES,
    MEASURES,
    MetricRow,
)

if TYPE_CHECKING:
    from s2rtools.translator_evaluation.report import TranslatorReport

_CONTENT = [measure for measure in CONTENT if measure.title]
_CONTROLS = (
    ("identity", "no translation"), ("repeated_image", "one repeated target image"),
    ("target", "target against target"),
)  # fmt: skip

_WHERE = {
    True: "that no translator was fitted on",
    False: "of the fit, because none or too few are held out",
    None: "of folders, perhaps used to train what translated them",
}


def reports_text(reports: Sequence[TranslatorReport], run: str | None) -> str:
    """Tables of translators that were judged on the same images."""
    return "\n".join(_parts(reports, run))


def _parts(reports: Sequence[TranslatorReport], run: str | None) -> Iterator[str]:
    first = reports[0]
    where = _WHERE[first.held_out]
    yield f"{first.images} images {where}; intervals {LEVEL_TEXT}\n"
    yield "Verdict on the content\n"
    yield output.table(
        ("translator", "method", "direction", "verdict", "ms per image"),
        [
            (r.name, r.method, r.direction, "accepted" if r.verdict.passed else "refused",
             _value(r.row("cost")))
            for r in reports
        ],
    )  # fmt: skip
    yield from (
        f"  {r.name}: refused: {'; '.join(r.verdict.reasons)}"
        for r in reports
        if not r.verdict.passed
    )
    yield from (f"  {r.name}: {note}" for r in reports for note in r.notes)
    zero = ", ".join(each.title for each in _CONTENT if each.better == "lower")
    yield f"\nContent kept (1 = as the source; {zero}: 0)\n"
    yield output.table(
        ("translator", *(measure.title for measure in _CONTENT)),
        [(r.name, *(_figure(r.content[each.name]) for each in _CONTENT)) for r in reports],
    )
    for target, group in groupby(sorted(reports, key=_target), key=_target):
        yield f"\nDistance to images of {target} (0 = equal)\n"
        yield _distances(list(group))
    if run is not None:
        yield f"\nTask: the network of run {run}\n"
        yield from _task(reports)
    if reports[0].row("downstream_gain"):
        yield "\nTask: the score of a model behind the translator\n"
        yield output.table(
            ("translator", "without", "with", "gain", "answer"),
            [
                (r.name, _bounded(r.row("downstream_score", "identity")),
                 _bounded(r.row("downstream_score")), _bounded(r.row("downstream_gain")),
                 _answer(r.row("downstream_gain")))
                for r in reports
            ],
        )  # fmt: skip


def _target(report: TranslatorReport) -> str:
    return report.target


def _distances(reports: list[TranslatorReport]) -> str:
    features = "network" if reports[0].row("kid_network") else "colour"
    shown = [each for each in DISTANCES if reports[0].row(each.name)]
    shares = [each for each in COVERAGE if each.name.endswith(features)]
    shares = [each for each in shares if reports[0].row(each.name)]
    entries = [(r.name, r, "translator") for r in reports]
    entries += [(title, reports[0], reference) for reference, title in _CONTROLS]
    return output.table(
        ("images", *(measure.title for measure in (*shown, *shares))),
        [
            (
                label,
                *(_bounded(report.row(each.name, reference)) for each in shown),
                *(_value(report.row(each.name, reference)) for each in shares),
            )
            for label, report, reference in entries
        ],
    )


def _task(reports: Sequence[TranslatorReport]) -> Iterator[str]:
    from s2rtools.translator_evaluation.task_metrics import claim

    rows, trained = [], []
    for report in reports:
        side, error = ("sim", "sim_error") if report.direction == "sim2real" else ("real", "error")
        gain = report.row(f"{error}_gain")
        if gain is not None:
            rows.append((
                report.name, side, _bounded(report.row(error, "identity")),
                _bounded(report.row(error)), _bounded(gain),
                claim(gain.interval),
                _percent(report.row("features_gain")),
            ))  # fmt: skip
        found = [row for row in report.rows if row.metric.startswith("trained_error")]
        for mean, better in zip(found[::2], found[1::2], strict=True):
            text = claim(better.interval)
            trained.append((report.name, mean.run, _bounded(mean), _bounded(better), text))
    if rows:
        yield "Mean position error, m, with the translator in front of the network\n"
        yield output.table(
            ("translator", "images", "without", "with", "gain", "answer", "features closer"), rows
        )
        yield "  each interval is that of one comparison, not corrected for their number"
    if trained:
        yield "\nMean real error, m, of networks trained on translated images\n"
        yield output.table(("translator", "run", "error", "gain", "answer"), trained)


def _figure(value: float) -> float:
    return round(float(value), 3)


def _value(row: MetricRow | None) -> float | None:
    return None if row is None else float(f"{row.interval.value:.3g}")


def _answer(gain: MetricRow | None) -> str:
    """Whether the gain of a score is known to be one."""
    if gain is None or not gain.interval.excludes_zero:
        return "no claim"
    return "helps" if gain.interval.value > 0 else "harms"


def _bounded(row: MetricRow | None) -> str:
    """Value and interval; `-` where there is none."""
    if row is None:
        return "-"
    number = f"{{:.{MEASURES[row.metric].digits}f}}".format
    plain = not row.interval.is_known and not row.interval.reason
    return number(row.interval.value) if plain else row.interval.with_bounds(number)


def _percent(row: MetricRow | None) -> str:
    if row is None:
        return "-"
    interval = row.interval.scaled(100)
    bounds = interval.bounds_text("{:.0f}".format, to=" .. ")
    return f"{interval.value:.0f} % ({bounds})"
