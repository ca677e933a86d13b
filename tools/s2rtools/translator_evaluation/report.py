"""Judge translators: content, distance, task and cost, with a verdict for each."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
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
from s2rtools.translator_evaluation.image_structure import Floats
from s2rtools.translator_evaluation.judged_frames import (
    JudgedFrames,
    instance_blocks,
    judged_instances,
    load_frames,
    runs_of_neighbours,
)
from s2rtools.translator_evaluation.named_translator import NamedTranslator
from s2rtools.translator_evaluation.task_metrics import TaskMetric

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

    Raises RequestError for unknown runs, a run in a store without poses, and too few images.
    """
    backend, run = None, None
    if settings.run is not None and not store.has_poses:
        raise RequestError(f"--run {settings.run}: {store.path} has no poses to judge the task by")
    if settings.run is not None:
        run = store.run(settings.run)
        backend = Backend(load_model(store, run.model, settings.trust))
    reports = []
    for number, translator in enumerate(translators):
        progress(number / len(translators), translator.name)
        chosen = judged_instances(
            store, translators, translator, settings.max_images, settings.seed
        )
        single = _Judge(store, translator, run, backend, settings.seed)
        reports.append(single.report(load_frames(store, translator, chosen), chosen.held_out))
    progress(1.0, "")
    return reports


@dataclass(frozen=True, slots=True)
class _Judge:
    """Judges one translator of a store; `run` and `backend` are those of the task's network."""

    store: Store
    translator: NamedTranslator
    run: Run | None
    backend: Backend | None
    seed: int

    def report(self, frames: JudgedFrames, held_out: bool) -> TranslatorReport:
        content = self._content(frames)
        notes = [] if held_out else ["judged on images of the fit: none or too few are held out"]
        task: list[TaskMetric] = []
        features: dict[str, Features] = {"colour": distance_metrics.colour_features}
        if self.run is not None and self.backend is not None:
            reason = task_metrics.unusable_reason(self.store, self.run, self.translator)
            if reason is not None:
                notes.append(f"task not judged: {reason}")
            else:
                _, note = task_metrics.untrained_rows(self.store, self.run, frames.iids)
                notes += [note] if note else []
                features["network"] = partial(self._embedding, self.run, self.backend, frames)
                task = task_metrics.run_time_metrics(
                    self.store, self.run, self.translator, self.backend, frames
                )
            name = self.translator.name
            task += task_metrics.training_metrics(self.store, self.run.run, name)
        cost = milliseconds_per_image(self.translator.stored.translator, frames.source[0])
        rows = (
            _content_rows(content)
            + [_distance_row(each, self.run) for each in self._distances(frames, features)]
            + [_task_row(each) for each in task]
            + [MetricRow("cost", "translator", None, cost, np.nan, np.nan, "ms")]
        )
        return TranslatorReport(
            name=self.translator.name,
            method=self.translator.stored.method,
            direction=self.translator.direction,
            source=self.translator.source,
            target=self.translator.target,
            images=len(frames.iids),
            held_out=held_out,
            verdict=judge(content),
            content=content,
            rows=tuple(rows),
            notes=tuple(notes),
        )

    def _content(self, frames: JudgedFrames) -> ContentMetrics:
        edges = None
        if frames.valid.any():
            edges = np.stack([
                content_metrics.depth_edges(depth, valid)
                for depth, valid in zip(frames.depth, frames.valid, strict=True)
            ])  # fmt: skip
        groups = runs_of_neighbours(self.store, frames.iids)
        return measure_content(frames.source, frames.translated, frames.target, groups, edges)

    def _distances(self, frames: JudgedFrames, features: Mapping[str, Features]) -> list[Distance]:
        if not frames.paired:
            return distance_metrics.folder_distances(
                frames.translated, frames.source, frames.target, self.seed
            )
        found = distance_metrics.paired_distances(
            {self.translator.name: frames.translated}, frames.source, frames.target,
            instance_blocks(self.store, frames.iids), features, self.seed,
        )  # fmt: skip
        return [*found[self.translator.name], *found[""]]

    def _embedding(self, run: Run, backend: Backend, frames: JudgedFrames, rgb: Rgb) -> Floats:
        """Features of images with the depth of the source, so that only colours differ."""
        return task_metrics.network_outputs(
            self.store, run, self.translator, backend, np.ascontiguousarray(rgb), frames.depth
        ).embedding


def _task_row(task: TaskMetric) -> MetricRow:
    interval = task.interval
    return MetricRow(task.metric, task.reference, task.run, interval.value, interval.low,
                     interval.high, task.unit)  # fmt: skip


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
        seconds: list[float] = []
        start = time.perf_counter()
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
    return from_folder(folder, max_images=max_images).images


def as_json(reports: Sequence[TranslatorReport]) -> list[dict[str, Any]]:
    """Reports as JSON data; non-finite values are null."""
    return [dict(plain(asdict(report))) for report in reports]


def folder_json(report: FolderReport) -> dict[str, Any]:
    """A report on folders as JSON data; non-finite values are null."""
    return dict(plain(asdict(report)))
