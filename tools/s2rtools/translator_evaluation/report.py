"""Judge translators: content, distance, task and cost, with a verdict for each."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from s2rstore.arrays.row_array import evenly_spaced
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.gap.report import plain
from s2rtools.inference import Backend
from s2rtools.models.load_model import load_model
from s2rtools.translation import fit_split
from s2rtools.translation.image_set import (
    ImageSet,
    Rgb,
    from_folder,
    read_image,
)
from s2rtools.translation.method import Translator
from s2rtools.translation.translator_file import StoredTranslator, names_digest
from s2rtools.translator_evaluation import (
    contact_sheet,
    content_metrics,
    distance_metrics,
    task_metrics,
)
from s2rtools.translator_evaluation.distance_metrics import Features
from s2rtools.translator_evaluation.downstream import (
    DownstreamModel,
    judge_downstream,
    read_truth,
)
from s2rtools.translator_evaluation.image_structure import Floats
from s2rtools.translator_evaluation.judged_frames import (
    MIN_IMAGES,
    JudgedFrames,
    NamedTranslator,
    Translation,
    instance_blocks,
    judged_instances,
    load_frames,
)
from s2rtools.translator_evaluation.measures import (
    Content,
    MetricRow,
    Verdict,
    figure,
    judge,
    measure_content,
)

MAX_IMAGES = 120
"""Most images on which translators are judged by default."""
MIN_TIMED, TIMED_SECONDS = 5, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class TranslatorReport:
    """How a translator was judged on `images` images, by content, distances and perhaps a task.

    `source` and `target` are domains of a store, or folders; a translator that was judged on
    folders has no direction. `run` is the run whose network judged the task, or None. `held_out`
    tells whether none of the images was used for the fit, None where it is not known. `notes` are
    for the reader.
    """

    name: str
    method: str
    direction: str = ""
    source: str
    target: str
    run: str | None = None
    images: int
    held_out: bool | None
    verdict: Verdict
    content: Content
    rows: tuple[MetricRow, ...]
    notes: tuple[str, ...] = ()

    def row(self, metric: str, reference: str = "translator") -> MetricRow | None:
        """The first figure of a metric."""
        found = (r for r in self.rows if (r.metric, r.reference) == (metric, reference))
        return next(found, None)


@dataclass(frozen=True, slots=True)
class ReportSettings:
    """`run` is the run whose network judges, None for no network; `seed` draws the images.

    Contact sheets are written to the folder `sheets`; none where it is None.
    """

    run: str | None = None
    max_images: int = MAX_IMAGES
    seed: int = 1
    trust: bool = False
    sheets: Path | None = None

    def write_sheet(self, report: TranslatorReport, frames: JudgedFrames) -> None:
        """Write the contact sheet of a translator, where sheets are written."""
        if self.sheets is not None:
            titles = (
                f"{report.source} (source)", f"{report.name} ({report.method})", report.target
            )  # fmt: skip
            sheet = contact_sheet.frames_sheet(frames, titles, self.seed)
            contact_sheet.write_png(self.sheets / f"{report.name}.png", sheet)


Progress = Callable[[float, str], None]


def evaluate(
    store: Store,
    translators: Sequence[Translation],
    settings: ReportSettings,
    progress: Progress = lambda fraction, name: None,
) -> list[TranslatorReport]:
    """Judge translations of one store on the same images, none of which was used for a fit.

    Raises RequestError for unknown runs, a run in a store without poses, and too few images.
    """
    backend, run = None, None
    if settings.run is not None and not store.has_poses:
        raise RequestError(f"--run {settings.run}: {store.path} has no poses to judge the task by")
    if settings.run is not None:
        run = store.run(settings.run)
        model = run.network("judging translators by it")
        backend = Backend(load_model(store, model, settings.trust))
    reports = []
    for number, translator in enumerate(translators):
        progress(number / len(translators), translator.name)
        chosen = judged_instances(
            store, translators, translator, settings.max_images, settings.seed
        )
        single = _Judge(store, translator, run, backend, settings.seed)
        held_out = chosen.held_out if isinstance(translator, NamedTranslator) else None
        frames = load_frames(store, translator, chosen)
        reports.append(single.report(frames, held_out))
        settings.write_sheet(reports[-1], frames)
    progress(1.0, "")
    return reports


@dataclass(frozen=True, slots=True)
class _Judge:
    """Judges one translator of a store; `run` and `backend` are those of the task's network."""

    store: Store
    translator: Translation
    run: Run | None
    backend: Backend | None
    seed: int

    def report(self, frames: JudgedFrames, held_out: bool | None) -> TranslatorReport:
        translator, content = self.translator, _content(frames)
        notes = []
        if held_out is False:
            notes.append("judged on images of the fit: none or too few are held out")
        features: dict[str, Features] = {"colour": distance_metrics.colour_features}
        task: list[MetricRow] = []
        if self.run is not None and self.backend is not None:
            run, backend = self.run, self.backend
            if reason := task_metrics.unusable_reason(self.store, run, translator):
                notes.append(f"task not judged: {reason}")
            else:
                _, note = task_metrics.untrained_rows(self.store, run, frames.iids)
                notes += [note] if note else []
                features["network"] = partial(self._embedding, run, backend, frames)
                task = task_metrics.run_time_metrics(self.store, run, translator, backend, frames)
            if isinstance(translator, NamedTranslator):
                task += task_metrics.training_metrics(
                    self.store, run.run, translator.name, translator.held_out
                )
        rows = [*_content_rows(content), *self._distances(frames, features), *task]
        if isinstance(translator, NamedTranslator):
            rows.append(_cost(translator.stored.translator, frames.source[0]))
        return TranslatorReport(
            name=translator.name,
            method=translator.method,
            direction=translator.direction,
            source=translator.source,
            target=translator.target,
            run=None if self.run is None else self.run.run,
            images=len(frames.iids),
            held_out=held_out,
            verdict=judge(content),
            content=content,
            rows=tuple(rows),
            notes=tuple(notes),
        )

    def _distances(self, frames: JudgedFrames, features: Mapping[str, Features]) -> list[MetricRow]:
        blocks = instance_blocks(self.store, frames.iids) if frames.paired else None
        found = distance_metrics.distances(
            frames.translated, frames.source, frames.target, features, blocks, self.seed
        )
        run = None if self.run is None else self.run.run
        return [replace(row, run=run) if row.metric.endswith("_network") else row for row in found]

    def _embedding(self, run: Run, backend: Backend, frames: JudgedFrames, rgb: Rgb) -> Floats:
        """Features of images with the depth of the source, so that only colours differ."""
        return task_metrics.network_outputs(
            self.store, run, self.translator, backend, np.ascontiguousarray(rgb), frames.depth
        ).embedding


def _content(frames: JudgedFrames) -> Content:
    edges = None
    if frames.valid.any():
        edges = np.stack([
            content_metrics.depth_edges(depth, valid)
            for depth, valid in zip(frames.depth, frames.valid, strict=True)
        ])  # fmt: skip
    return measure_content(frames.source, frames.translated, frames.target, frames.groups, edges)


def _content_rows(content: Content) -> list[MetricRow]:
    return [figure(name, value) for name, value in content.items()]


def _cost(translator: Translator, image: Rgb) -> MetricRow:
    return figure("cost", milliseconds_per_image(translator, image))


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


@dataclass(frozen=True, slots=True, eq=False)
class Downstream:
    """A model behind the translator, and the folder of the truths of the source's images."""

    model: DownstreamModel
    truth: Path


def evaluate_folders(
    source: Path,
    target: Path,
    stored: StoredTranslator,
    name: str,
    settings: ReportSettings,
    downstream: Downstream | None = None,
) -> TranslatorReport:
    """Judge a translator on evenly spaced images of two folders, at the size of the source's.

    Of the folders that it was fitted on, only held-out images are judged where there are enough.
    Raises RequestError for folders without images.
    """
    before = from_folder(source)
    images = before, from_folder(target, before.size)
    held_out, rows = _held_out_rows(images, stored)
    before, after = (
        each.rows(evenly_spaced(kept, settings.max_images))
        for each, kept in zip(images, rows, strict=True)
    )
    if min(len(before), len(after)) < 4:
        raise RequestError(f"{source}, {target}: judging needs at least 4 images of each")
    frames = JudgedFrames.of_colours(before, stored.translator.translate(before.images), after)
    content = _content(frames)
    features = {"colour": distance_metrics.colour_features}
    figures = _content_rows(content) + distance_metrics.distances(
        frames.translated, frames.source, frames.target, features, seed=settings.seed
    )
    if downstream is not None:
        figures += judge_downstream(
            downstream.model, stored.translator,
            (read_image(source / name) for name in before.names),
            [read_truth(downstream.truth, name) for name in before.names], before.groups,
        )  # fmt: skip
    figures.append(_cost(stored.translator, before.images[0]))
    report = TranslatorReport(
        name=name, method=stored.method, source=source.name, target=target.name,
        images=len(before), held_out=held_out, verdict=judge(content), content=content,
        rows=tuple(figures),
    )  # fmt: skip
    settings.write_sheet(report, frames)
    return report


def _held_out_rows(
    images: tuple[ImageSet, ImageSet], stored: StoredTranslator
) -> tuple[bool | None, list[NDArray[np.intp]]]:
    """Whether the rows to judge are held out (None: not known), and the rows of both folders."""
    everything = [np.arange(len(each)) for each in images]
    if stored.folders != tuple(names_digest(each) for each in images):
        return None, everything
    rows = [
        np.flatnonzero(fit_split.split_codes(each.groups) == fit_split.HELD_OUT) for each in images
    ]
    if min(map(len, rows)) < MIN_IMAGES:
        return False, everything
    return True, rows


def as_json(report: TranslatorReport) -> dict[str, Any]:
    """A report as JSON data; non-finite values are null."""
    return dict(plain(asdict(report)))


def save_reports(root: Path, reports: Sequence[TranslatorReport]) -> None:
    """Save the figures of each translator in the store's index, and whether it is accepted.

    Earlier figures of the same run and of no run are replaced; those of other runs, and of networks
    trained on translated images, stay unless they are measured again.
    """
    with edit(root) as draft:
        for report in reports:
            new = [
                _index_row(report.name, row)
                for row in report.rows
                if math.isfinite(row.interval.value)
            ]
            measured = {(row["metric"], row["reference"], row["run"]) for row in new}
            columns = ", ".join(_INDEX_COLUMNS)
            kept = draft.rows(
                f"SELECT {columns} FROM translator_metric WHERE translator = ?", [report.name]
            )
            draft.delete("translator_metric", translator=report.name)
            for values in kept:
                row = dict(zip(_INDEX_COLUMNS, values, strict=True))
                again = (row["metric"], row["reference"], row["run"]) in measured
                own = row["run"] in (None, report.run) and not row["metric"].startswith("trained_")
                if not (again or own):
                    draft.insert_row("translator_metric", row)
            for row in new:
                draft.insert_row("translator_metric", row)
            verdict = report.verdict
            draft.update(
                "translator",
                {"translator": report.name},
                {"accepted": verdict.passed, "reasons": json.dumps(list(verdict.reasons))},
            )
            facts = {"judged_images": report.images, "judged_held_out": report.held_out}
            draft.set_provenance(f"translator:{report.name}", facts)


_INDEX_COLUMNS = ("translator", "metric", "reference", "run", "value", "low", "high", "reason",
                  "unit")  # fmt: skip


def _index_row(name: str, row: MetricRow) -> dict[str, Any]:
    """A row of table `translator_metric`; unknown bounds are None."""
    figures = row.interval.as_columns("x").values()
    values = (name, row.metric, row.reference, row.run, *figures, row.unit)
    return dict(zip(_INDEX_COLUMNS, values, strict=True))
