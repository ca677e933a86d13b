"""What a translator does to the task: errors and features of a run's pose network.

Networks are given the frames of the store here, before and after the translation alike, not the
images of the source's size. A gain is positive where the translator helps. Its interval is that of
paired differences, on images that were not used for the fit; where it holds zero, no claim is made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.findings.costliest_factor import TESTED_TRANSLATORS
from s2rstore.geometry.camera_offset import UNCHANGED
from s2rstore.intervals import LEVEL, Interval, mean, paired_difference, simultaneous_level
from s2rstore.metrics import pose_metrics, run_metrics
from s2rstore.reader import Store
from s2rstore.records import Domain, Run, Side
from s2rstore.run_inputs import run_render_change
from s2rtools.adjustments import Chain, translator_name
from s2rtools.inference import Backend
from s2rtools.precompute.frame_reader import side_frames
from s2rtools.translation.image_set import Rgb
from s2rtools.translator_evaluation.image_structure import Floats
from s2rtools.translator_evaluation.judged_frames import (
    MIN_IMAGES,
    Iids,
    JudgedFrames,
    Translation,
)
from s2rtools.translator_evaluation.measures import MetricRow, figure

RECIPE = "translated"
"""Name of the training recipe that trains on translated sim images."""
_BATCH = 16


@dataclass(frozen=True, slots=True, eq=False)
class NetworkOutputs:
    """Poses (N, 3) and embeddings (N, D) of some images."""

    pose: NDArray[np.float64]
    embedding: Floats


def claim(interval: Interval, unit: str = "m") -> str:
    """A gain in words; no claim where its interval is unknown or holds zero."""
    if not interval.is_known:
        return f"no claim: {interval.bounds_text()}"
    if not interval.excludes_zero:
        return "no claim: the interval holds zero"
    verb = "less" if interval.value > 0 else "more"
    return f"{abs(interval.value):.2f} {unit} {verb} error"


def unusable_reason(store: Store, run: Run, translator: Translation) -> str | None:
    """Why a run's network cannot judge a translator, else None."""
    side = translator.side
    if run.domain(side) != translator.source:
        return f"run {run.run} has the {side} domain {run.domain(side)}, not {translator.source}"
    if any(translator_name(str(step["name"])) for step in run.adjustments(side)):
        return f"run {run.run} translates its {side} images already"
    if run_render_change(store, run, side) != UNCHANGED:
        return f"run {run.run} moves the {side} cameras"
    return None


def network_outputs(
    store: Store, run: Run, translator: Translation, backend: Backend, rgb: Rgb,
    depth: NDArray[Any],
) -> NetworkOutputs:  # fmt: skip
    """Outputs for images (N, H, W, 3) and raw depth (N, H, W) of the translated side.

    The run's own adjustments follow the translation.
    """
    side = translator.side
    domain, chain = store.domain(translator.source), run.adjustments(side)
    return _outputs(store, backend, rgb, depth, domain, chain)


def target_outputs(
    store: Store, run: Run, translator: Translation, backend: Backend, iids: Iids
) -> NetworkOutputs:
    """Outputs for the target's images at the same poses, with its own adjustments."""
    domain = store.domain(translator.target)
    side: Side = "real" if translator.side == "sim" else "sim"
    chain = run.adjustments(side) if run.domain(side) == translator.target else []
    chain = [step for step in chain if translator_name(str(step["name"])) is None]
    frames = [store.frames(translator.target, int(i), int(i) + 1) for i in iids]
    rgb, depth = (np.concatenate([each[name] for each in frames]) for name in ("rgb", "depth"))
    return _outputs(store, backend, rgb, depth, domain, chain)


def _outputs(
    store: Store, backend: Backend, rgb: Rgb, depth: NDArray[Any], domain: Domain, chain: Chain
) -> NetworkOutputs:
    contract = backend.model.contract
    poses, embeddings = [], []
    for start in range(0, len(rgb), _BATCH):
        rows = slice(start, start + _BATCH)
        images = {"rgb": rgb[rows], "depth": depth[rows]}
        frames = side_frames(images, domain, chain, contract, store.path)
        forward = backend.forward_all(frames.x)
        poses.append(forward.pose)
        embeddings.append(forward.embedding.float().cpu().numpy().astype(np.float64))
    return NetworkOutputs(np.concatenate(poses), np.concatenate(embeddings))


def position_errors(store: Store, domain: str, iids: Iids, outputs: NetworkOutputs) -> Floats:
    """Position errors (N,) in metres of outputs for images of a domain."""
    truth = store.poses(domain)[iids]
    return pose_metrics.position_error(
        outputs.pose[:, 0], outputs.pose[:, 1], truth[:, 0], truth[:, 1]
    )


def untrained_rows(store: Store, run: Run, iids: Iids) -> tuple[NDArray[np.intp], str | None]:
    """Rows of `iids` whose poses the run's network was not trained on, and a note.

    All rows where the run was not computed yet, or where fewer than `MIN_IMAGES` remain.
    """
    everything = np.arange(len(iids))
    if run.key is None:
        note = (
            f"run {run.run} is not computed: its network may have been trained on some of these "
            "poses"
        )
        return everything, note
    rows = np.flatnonzero(run_metrics.population(store, run.run)[iids])
    if rows.size < MIN_IMAGES:
        return everything, f"the network of run {run.run} was trained on most of these poses"
    return rows, None


def run_time_metrics(
    store: Store, run: Run, translator: Translation, backend: Backend, frames: JudgedFrames
) -> list[MetricRow]:
    """Errors and features with and without the translator in front of the network.

    - `error`: mean position error on the translated images, on the source's (identity) and on the
      target's at the same poses (target).
    - `error_gain`: error of the source's images minus that of the translated ones, paired;
      `error_gain_tested` is the same at the level of one among `TESTED_TRANSLATORS`.
    - `features_gain`: by how much the features come closer to those of the target at the same
      pose, as a share of the distance without translation; paired.

    For translators of sim images the errors and gains are named `sim_error` and so on: they say
    nothing about reality.
    """
    plain = network_outputs(store, run, translator, backend, frames.source, frames.depth)
    moved = network_outputs(
        store, run, translator, backend, frames.translated, frames.translated_depth
    )
    ideal = target_outputs(store, run, translator, backend, frames.iids)
    untrained, _ = untrained_rows(store, run, frames.iids)
    recording = store.instances.trajectory[frames.iids[untrained]]
    errors = {
        reference: position_errors(store, domain, frames.iids, outputs)[untrained]
        for reference, domain, outputs in (
            ("translator", translator.source, moved),
            ("identity", translator.source, plain),
            ("target", translator.target, ideal),
        )
    }
    error = "error" if translator.side == "real" else "sim_error"
    rows = [
        figure(error, mean(values, recording), reference, run.run)
        for reference, values in errors.items()
    ]
    decrease = errors["identity"] - errors["translator"]
    for suffix, level in (("", LEVEL), ("_tested", simultaneous_level(TESTED_TRANSLATORS))):
        gain = paired_difference(decrease, recording, level=level)
        rows.append(figure(f"{error}_gain{suffix}", gain, run=run.run))
    before, after = (
        np.linalg.norm(each.embedding - ideal.embedding, axis=1)[untrained]
        for each in (plain, moved)
    )
    if before.mean() > 0:
        closer = paired_difference((before - after) / before.mean(), recording)
        rows.append(figure("features_gain", closer, run=run.run))
    return rows


def training_metrics(store: Store, run: str, name: str, held_out: Iids) -> list[MetricRow]:
    """Errors in reality of runs whose network was trained on images translated by `name`.

    `trained_error` is the mean real error of such a run, `trained_error_gain` the real error of
    `run` minus it, paired on the instances that both networks were not trained on, of those
    that the translator's fit held out (iids). Empty where no such run was computed.
    """
    rows: list[MetricRow] = []
    if store.run(run).key is None:
        return rows
    for record in store.runs.values():
        used = [translator_name(str(step["name"])) for step in record.sim_adjustments]
        recipe = store.provenance(f"model:{record.model}").get("recipe")
        if record.run == run or recipe != RECIPE or name not in used or record.key is None:
            continue
        keep = run_metrics.population(store, run) & run_metrics.population(store, record.run)
        keep &= np.isin(np.arange(len(keep)), held_out)
        compared = store.in_recording_order(keep)
        recording = store.instances.trajectory[compared]
        plain, trained = (
            store.run_columns(each).real.error[compared].astype(np.float64)
            for each in (run, record.run)
        )
        for metric, interval in (
            ("trained_error", mean(trained, recording)),
            ("trained_error_gain", paired_difference(plain - trained, recording)),
        ):
            rows.append(figure(metric, interval, run=record.run))
    return rows
