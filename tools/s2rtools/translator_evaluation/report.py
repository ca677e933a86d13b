"""Judge translators: content, distance, task and cost, with a verdict for each."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.gap.report import plain
from s2rtools.inference import Backend
from s2rtools.models.load_model import load_model
from s2rtools.translation.image_set import Rgb, from_folder, resize
from s2rtools.translation.method import Translator
from s2rtools.translator_evaluation import content_metrics, distance_metrics, task_metrics
from s2rtools.translator_evaluation.content_summary import ContentMetrics, measure_content
from s2rtools.translator_evaluation.distance_metrics import Distance, Features
from s2rtools.translator_evaluation.gates import Verdict, judge
from s2rtools.translator_evaluation.judged_frames import (
    JudgedFrames,
    instance_blocks,
    judged_instances,
    load_frames,
    runs_of_neighbours,
)
from s2rtools.translator_evaluation.named_translator import NamedTranslator

MAX_IMAGES = 120
"""Most images on which translators are judged by default."""
MIN_TIMED, TIMED_SECONDS = 5, 0.5


@dataclass(frozen=True, slots=True)
class MetricRow:
    """One figure of a report; NaN bounds where the interval is unknown.

    `reference` is translator, identity, repeated_image or target, `run` the run whose network was
    used or None.
    """

    metric: str
    reference: str
    run: str | None
    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, slots=True)
class TranslatorReport:
    """How a translator was judged on `images` images.

    `held_out` tells whether none of them was used for the fit; `notes` are for the reader.
    """

    name: str
    method: str
    direction: str
    source: str
    target: str
    images: int
    held_out: bool
    verdict: Verdict
    content: ContentMetrics
    rows: tuple[MetricRow, ...]
    notes: tuple[str, ...]

    def row(self, metric: str, reference: str = "translator") -> MetricRow | None:
        """The first figure of a metric."""
        found = (r for r in self.rows if (r.metric, r.reference) == (metric, reference))
        return next(found, None)


@dataclass(frozen=True, slots=True)
class ReportSettings:
    """`run` is the run whose network judges, None for no network; `seed` draws the images."""

    run: str | None = None
    max_images: int = MAX_IMAGES
    seed: int = 1
    trust: bool = False


Progress = Callable[[float, str], None]


def evaluate(
    store: Store,
    translators: Sequence[NamedTranslator],
    settings: ReportSettings,
    progress: Progress = lambda fraction, name: None,
) -> list[TranslatorReport]:
    """Judge translators of one store on the same images, none of which was used for a fit.

    Raises RequestError for unknown runs, stores with too few instances, and domains that image
    different instances.
    """
    for translator in translators:
        domains = translator.source, translator.target
        if not np.all([store.imaged(domain) for domain in domains]):
            raise RequestError(
                f"{store.path}: {' and '.join(domains)} image different instances; "
                "the report compares both domains at the same ones"
            )
    backend, run = None, None
    if settings.run is not None:
        run = store.run(settings.run)
        backend = Backend(load_model(store, run.model, settings.trust))
    iids, held_out = judged_instances(store, list(translators), settings.max_images, settings.seed)
    reports = []
    for number, translator in enumerate(translators):
        progress(number / len(translators), translator.name)
        frames = load_frames(store, translator, iids)
        reports.append(_judge(store, translator, frames, held_out, run, backend, settings.seed))
    progress(1.0, "")
    return reports


def _judge(
    store: Store,
    translator: NamedTranslator,
    frames: JudgedFrames,
    held_out: bool,
    run: Run | None,
    backend: Backend | None,
    seed: int,
) -> TranslatorReport:
    scale = store.domain(translator.source).depth_scale
    edges = np.stack([
        content_metrics.depth_edges(depth * scale, valid)
        for depth, valid in zip(frames.depth, frames.valid, strict=True)
    ])  # fmt: skip
    groups = runs_of_neighbours(store, frames.iids)
    content = measure_content(frames.source, frames.translated, frames.target, groups, edges)
    notes = [] if held_out else ["judged on images of the fit: none or too few are held out"]
    features: dict[str, Features] = {"colour": distance_metrics.colour_features}
    usable = run is not None
    if run is not None and backend is not None:
        reason = task_metrics.unusable_reason(store, run, translator)
        if reason is not None:
            notes.append(f"task not judged: {reason}")
            usable = False
        else:
            _, note = task_metrics.untrained_rows(store, run, frames.iids)
            notes += [note] if note else []
            features["network"] = partial(_embedding, store, run, translator, backend, frames)
    blocks = instance_blocks(store, frames.iids)
    found = distance_metrics.paired_distances(
        {translator.name: frames.translated}, frames.source, frames.target, blocks, features, seed
    )
    rows = _content_rows(content) + [
        _distance_row(distance, run) for distance in (*found[translator.name], *found[""])
    ]
    if run is not None and backend is not None and usable:
        task = task_metrics.run_time_metrics(store, run, translator, backend, frames)
        task += task_metrics.training_metrics(store, run.run, translator.name)
        rows += [
            MetricRow(t.metric, t.reference, t.run, t.interval.value, t.interval.low,
                      t.interval.high, t.unit)
            for t in task
        ]  # fmt: skip
    cost = milliseconds_per_image(translator.stored.translator, frames.source[0])
    rows.append(MetricRow("cost", "translator", None, cost, np.nan, np.nan, "ms"))
    return TranslatorReport(
        name=translator.name,
        method=translator.stored.method,
        direction=translator.direction,
        source=translator.source,
        target=translator.target,
        images=len(frames.iids),
        held_out=held_out,
        verdict=judge(content),
        content=content,
        rows=tuple(rows),
        notes=tuple(notes),
    )


def _embedding(
    store: Store, run: Run, translator: NamedTranslator, backend: Backend, frames: JudgedFrames,
    rgb: Rgb,
) -> Any:  # fmt: skip
    """Features of images with the depth of the source, so that only colours differ."""
    return task_metrics.network_outputs(
        store, run, translator, backend, np.ascontiguousarray(rgb), frames.depth
    ).embedding


def _content_rows(content: ContentMetrics) -> list[MetricRow]:
    return [
        MetricRow(name, "translator", None, float(value), np.nan, np.nan, "")
        for name, value in asdict(content).items()
        if name != "images"
    ]


def _distance_row(distance: Distance, run: Run | None) -> MetricRow:
    interval = distance.interval
    name = run.run if run is not None and distance.metric.endswith("_network") else None
    return MetricRow(distance.metric, distance.reference, name, interval.value, interval.low,
                     interval.high, distance.unit)  # fmt: skip


def milliseconds_per_image(translator: Translator, image: Rgb) -> float:
    """Median time of translating one image (H, W, 3) on one thread; for information only."""
    threads, cv_threads = torch.get_num_threads(), cv2.getNumThreads()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    try:
        translator.translate(image[None])
        seconds, start = [], time.perf_counter()
        while len(seconds) < MIN_TIMED or time.perf_counter() - start < TIMED_SECONDS:
            before = time.perf_counter()
            translator.translate(image[None])
            seconds.append(time.perf_counter() - before)
    finally:
        torch.set_num_threads(threads)
        cv2.setNumThreads(cv_threads)
    return 1000 * float(np.median(seconds))


@dataclass(frozen=True, slots=True)
class FolderReport:
    """How a translator was judged on folders, which have no poses: content and colours."""

    images: int
    verdict: Verdict
    content: ContentMetrics
    rows: tuple[MetricRow, ...]


def evaluate_folders(
    source: Path, target: Path, translator: Translator, max_images: int = MAX_IMAGES
) -> FolderReport:
    """Judge a translator on evenly spaced images of two folders.

    Raises RequestError for folders without images.
    """
    before, look = _read_folder(source, max_images), _read_folder(target, max_images)
    if min(len(before), len(look)) < 4:
        raise RequestError(f"{source}, {target}: judging needs at least 4 images of each")
    translated = translator.translate(before)
    content = measure_content(before, translated, look)
    distances = distance_metrics.folder_distances(
        translated, before, resize(look, (before.shape[1], before.shape[2]))
    )
    cost = milliseconds_per_image(translator, before[0])
    rows = _content_rows(content) + [_distance_row(distance, None) for distance in distances]
    rows.append(MetricRow("cost", "translator", None, cost, np.nan, np.nan, "ms"))
    return FolderReport(len(before), judge(content), content, tuple(rows))


def _read_folder(folder: Path, max_images: int) -> Rgb:
    images = from_folder(folder).images
    chosen = np.unique(np.linspace(0, len(images) - 1, min(max_images, len(images))).astype(int))
    return images[chosen]


def as_json(reports: Sequence[TranslatorReport]) -> list[dict[str, Any]]:
    """Reports as JSON data; non-finite values are null."""
    return [dict(plain(asdict(report))) for report in reports]


def folder_json(report: FolderReport) -> dict[str, Any]:
    """A report on folders as JSON data; non-finite values are null."""
    return dict(plain(asdict(report)))
