"""Choice of the backends of a run: made once, recorded in the index, then kept.

It follows from the machine, its packages, the model and the images; nothing is timed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from importlib import metadata
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.documents import parse_object
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rtools.common.blocks import evenly_spread
from s2rtools.heatmaps import HEATMAP_KINDS, PairBatch
from s2rtools.heatmaps.occlusion import Occlusion
from s2rtools.inference import Backend, MeasuredBackend, choose_backend, open_backend, open_float32
from s2rtools.inference.backend import has_bfloat16_units
from s2rtools.inference.calibration import AUTO, measure_backend
from s2rtools.inference.cuda_backend import CudaBackend
from s2rtools.inference.winograd_backend import WinogradBackend
from s2rtools.models.load_model import load_model
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute.array_keys import content_key
from s2rtools.precompute.frame_reader import PairFrames, read_pairs
from s2rtools.precompute.run_backends import (
    FLOAT32,
    REDUCED_DIFFERENCES,
    BackendIdentity,
    Differences,
    RunBackends,
)
from s2rtools.precompute.tasks.network_outputs import side_batch

DEFAULT_VARIABLE = "S2R_BACKEND"
"""Environment variable that names the backend where none is requested."""
HEATMAP_ERROR = 0.01
"""Largest RMS error of a heatmap in reduced precision, in deviations of its values."""
_CHOICE_BYTES = 65_536
_PLACES, _PAIRS_PER_PLACE = 8, 2
_OCCLUSION_PLACES = 2
_WINOGRAD_IMAGES = 16
"""So few images suffice for a backend whose error is that of float32."""
_FEWEST_INSTANCES = 256
"""In smaller stores, measuring reduced precision of occlusion costs more than it saves."""


def run_backends(
    store: Store,
    run: Run,
    trust: bool,
    kinds: Sequence[str],
    requested: str,
    report_line: Callable[[str], None],
    check: Callable[[], None] = lambda: None,
    threads: int = 0,
    has_differences: bool = True,
) -> RunBackends:
    """The recorded backends of a run; chosen, reported and recorded where there are none yet.

    A recorded choice is kept unless `requested` names another backend than that of the
    predictions. `check` is called before it is recorded. Backends are measured with `threads`, by
    default torch's setting. `has_differences` tells whether the precision of differences is chosen,
    which only occlusion needs. Raises RequestError for an unknown or inaccurate backend.
    """
    requested = (os.environ.get(DEFAULT_VARIABLE) or AUTO) if requested == AUTO else requested
    inputs = _input_key(store, run)
    kept = _kept(store, run, requested, inputs)
    sample = _Sample(store, run, trust, threads)
    chosen = kept
    if chosen is None:
        chosen = _choose(sample, requested, inputs, kinds)
        report_line(f"{run.run}: {_summary(chosen)}")
    if has_differences and Occlusion.name in kinds and chosen.differences is None:
        named = str(chosen.facts.get("requested", requested))
        chosen = _with_differences(chosen, sample, named)
        if chosen.differences in REDUCED_DIFFERENCES:
            error = float(chosen.facts["occlusion_error"])
            report_line(f"{run.run}: occlusion in bfloat16 differences, {error:.1%} off")
    if chosen != kept:
        content = msgspec.json.encode(chosen)
        atomic_writes.write(store.path, _choice_file(run), content, check=check)
    return chosen


def _choice_file(run: Run) -> str:
    """The file of a choice that is not published yet; it goes with the results of units."""
    return f"{layout.UNITS}/{run.run}/backend.json"


def _kept(store: Store, run: Run, requested: str, inputs: str) -> RunBackends | None:
    """The backends that a killed precompute had chosen, or those of the published arrays.

    None where they are of another model or of other images, or where `requested` names another
    backend. A choice by name that was not published holds for the same name, and for runs of which
    nothing is published.
    """
    file, where = _choice_file(run), f"{store.path}: run {run.run}"
    record = store.provenance_object(f"run:{run.run}", "backend")
    records = [RunBackends.from_record(record, where)] if record else []
    if safe_files.kind(store.path, file) is not None:
        content = safe_files.read(store.path, file, _CHOICE_BYTES)
        found = parse_object(content.decode(errors="replace"), str(store.path / file))
        begun = RunBackends.from_record(found, where)
        if run.key is None or begun.facts.get("requested") == requested:
            records.insert(0, begun)
    for kept in records:
        if kept.facts.get("inputs") == inputs and requested in (AUTO, kept.predictions.name):
            return kept
    return None


def _input_key(store: Store, run: Run) -> str:
    """Key of the model and of what it looks at: the choice holds for these."""
    model = store.models[run.network("the choice of a backend")]
    sides = [[run.domain(side), run.adjustments(side)] for side in SIDES]
    facts = {"model": model.sha256, "convention": model.convention, "sides": sides}
    return content_key({**facts, "input": model.input})


class _Sample:
    """The calibration batch: image pairs from places spread evenly over the data set."""

    def __init__(self, store: Store, run: Run, trust: bool, threads: int) -> None:
        """`threads` are those of the backends that are measured on it."""
        self._store, self._run, self._trust = store, run, trust
        self.threads = threads
        self.ranges = store.imaged_ranges(run.sim_domain, run.real_domain)
        self._frames: list[tuple[int, PairFrames]] | None = None

    @cached_property
    def model(self) -> LoadedModel:
        return load_model(self._store, self._run.network("inference"), self._trust)

    def frames(self) -> list[tuple[int, PairFrames]]:
        """First iid and frames of the pairs at each place."""
        if self._frames is None:
            contract, iids = self.model.contract, np.concatenate(self.ranges)
            starts = iids[evenly_spread(max(1, iids.size - _PAIRS_PER_PLACE + 1), _PLACES)]
            self._frames = [
                batch
                for start in starts
                for batch in read_pairs(
                    self._store, self._run, contract, int(start),
                    min(int(start) + _PAIRS_PER_PLACE, self._stop(start)), _PAIRS_PER_PLACE,
                )
            ]  # fmt: skip
        return self._frames

    def _stop(self, iid: int) -> int:
        """The end of the consecutive instances with images in both domains from `iid` on."""
        return next(iids.stop for iids in self.ranges if iid in iids)

    def inputs(self) -> NDArray[np.float32]:
        """Network inputs of both sides, (B, C, h, w)."""
        return np.concatenate([frames[side].x for _, frames in self.frames() for side in SIDES])

    def pairs(self, backend: Backend, places: int = _PLACES) -> Iterator[PairBatch]:
        """The pairs at some of the places after the forward pass of a backend."""
        truth = {side: self._store.poses(self._run.domain(side)) for side in SIDES}
        for iid, frames in self.frames()[:: max(1, _PLACES // places)]:
            rows = slice(iid, iid + len(frames["sim"].x))
            sim, real = (side_batch(backend, frames[side], truth[side][rows]) for side in SIDES)
            yield PairBatch(backend.model, backend, sim, real)


def _choose(sample: _Sample, requested: str, inputs: str, kinds: Sequence[str]) -> RunBackends:
    """Choose the backends of predictions and of heatmaps, and check these on the sample.

    Where heatmaps of `kinds` go on from the outputs of all operations, `auto` takes the backend
    that keeps these for heatmaps that are too inaccurate in reduced precision. It computes the
    predictions, too, unless the processor has matrix units for reduced precision.
    """
    facts = {"inputs": inputs, "requested": requested}
    if requested == Backend.name:
        backend = open_backend(sample.model, requested, sample.threads)
        return _backends(MeasuredBackend(backend, 0.0, 0.0), backend, facts)
    keeping = None
    if requested == AUTO and _needs_base(sample.model, kinds):
        keeping = _keeping_backend(sample)
    if keeping is not None and not has_bfloat16_units():
        return _backends(keeping, keeping.backend, facts)
    measured = choose_backend(sample.model, sample.inputs(), requested, sample.threads)
    heat = measured.backend
    if not heat.is_float32:
        exact = keeping.backend if keeping else open_float32(sample.model, sample.threads)
        error = _heatmap_error(sample, heat, exact)
        if error > HEATMAP_ERROR:
            heat = exact
        else:
            facts["heatmap_error"] = f"{error:.2g}"
    return _backends(measured, heat, facts)


def _keeping_backend(sample: _Sample) -> MeasuredBackend | None:
    """The backend that keeps the outputs of all operations; None where it is inaccurate."""
    backend = WinogradBackend(sample.model, sample.threads)
    images = sample.inputs()[:_WINOGRAD_IMAGES]
    measured = measure_backend(sample.model, images, backend, sample.threads)
    return measured if measured.accurate else None


def _needs_base(model: LoadedModel, kinds: Sequence[str]) -> bool:
    """Whether occlusion of a model can reuse the activations of a forward pass on the CPU."""
    kind = Occlusion()
    return (
        kind.name in kinds
        and CudaBackend.unavailable_reason() is not None
        and kind.suits(model)
        and WinogradBackend.suits(model)
        and kind.uses_base(kind.attributes(model))
    )


def _backends(measured: MeasuredBackend, heat: Backend, facts: dict[str, str]) -> RunBackends:
    backend = measured.backend
    return RunBackends(
        BackendIdentity.of(backend),
        BackendIdentity.of(heat),
        None,
        {
            **facts,
            "metres": float(f"{measured.metres:.3g}"),
            "radians": float(f"{measured.radians:.3g}"),
            "library": f"{backend.library} {metadata.version(backend.library)}",
            "device": backend.device_name,
        },
    )


def _heatmap_error(sample: _Sample, backend: Backend, exact: Backend) -> float:
    """Largest RMS error of the heatmaps that use features, in deviations of their values."""
    kinds = [
        kind for kind in HEATMAP_KINDS.values()
        if kind.uses_features and kind.suits(sample.model)
    ]  # fmt: skip
    reduced, expected = (
        [kind.compute(pair) for pair in sample.pairs(each) for kind in kinds]
        for each in (backend, exact)
    )
    errors = [0.0]
    for number in range(len(kinds)):
        for key in expected[number]:
            values, reference = (
                np.concatenate([maps[key] for maps in part[number :: len(kinds)]])
                for part in (reduced, expected)
            )
            errors += _relative_errors(values, reference)
    return max(errors)


def _relative_errors(values: NDArray[Any], expected: NDArray[Any]) -> list[float]:
    """RMS error of each plane, or of the one map (B, h, w), in deviations of its values.

    Infinite where only one of the two is finite.
    """
    if values.ndim == 3:
        values, expected = values[:, None], expected[:, None]
    planes = (1, 0, 2, 3)
    pairs = zip(values.transpose(planes), expected.transpose(planes), strict=True)
    return [_relative_error(of_plane, reference) for of_plane, reference in pairs]


def _relative_error(values: NDArray[Any], expected: NDArray[Any]) -> float:
    finite = np.isfinite(expected)
    if not np.array_equal(np.isfinite(values), finite):
        return float("inf")
    if not finite.any():
        return 0.0
    values, expected = (each[finite].astype(np.float64) for each in (values, expected))
    return float(np.sqrt(np.mean(np.square(values - expected))) / max(expected.std(), 1e-12))


def _with_differences(backends: RunBackends, sample: _Sample, requested: str) -> RunBackends:
    """Choose the precision of the differences from which occlusion is computed."""
    precision: Differences = FLOAT32
    facts = dict(backends.facts)
    kind, model = Occlusion(), sample.model
    enough = sum(map(len, sample.ranges)) >= _FEWEST_INSTANCES
    if requested == AUTO and enough and kind.suits(model) and kind.is_local(model):
        reduced = _reduced_differences(kind, sample, backends.heatmaps.open(model, sample.threads))
        if reduced is not None:
            precision, error = reduced
            facts["occlusion_error"] = f"{error:.2g}"
    return replace(backends, differences=precision, facts=facts)


def _reduced_differences(
    kind: Occlusion, sample: _Sample, backend: Backend
) -> tuple[Differences, float] | None:
    """The fastest accurate precision of differences, and the error of occlusion by it.

    The error is the largest RMS error in deviations of the values. None where float32 is as fast:
    on a GPU, where reduced precision was measured to save little, and on a processor without
    matrix units for bfloat16.
    """
    if backend.device.type != "cpu" or not has_bfloat16_units():
        return None
    pairs = list(sample.pairs(backend, _OCCLUSION_PLACES))

    def maps(precision: str) -> dict[Any, NDArray[Any]]:
        backend.differences = precision
        parts = [kind.compute(pair) for pair in pairs]
        return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}

    exact = maps(FLOAT32)
    for precision in REDUCED_DIFFERENCES:
        reduced = maps(precision)
        error = max(e for key in exact for e in _relative_errors(reduced[key], exact[key]))
        if error <= HEATMAP_ERROR:
            return precision, error
    return None


def _summary(backends: RunBackends) -> str:
    """The choice in one line, as `openvino bf16, at most 0.4 mm and 0.02 degrees off`."""
    facts = backends.facts
    parts = [backends.predictions.label]
    if backends.predictions.name != Backend.name:
        degrees = np.degrees(float(facts["radians"]))
        parts.append(
            f"at most {1000 * float(facts['metres']):.1g} mm and {degrees:.1g} degrees off"
        )
    text = ", ".join(parts)
    if backends.heatmaps != backends.predictions:
        text += f"; heatmaps in {backends.heatmaps.label}"
    elif "heatmap_error" in facts:
        text += f"; heatmaps {float(facts['heatmap_error']):.1%} off"
    return text
