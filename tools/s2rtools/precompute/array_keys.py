"""Keys of a run's arrays: hashes over everything that their values depend on, and nothing else.

Arrays that releases up to 0.2.0 published or began keep the keys that these gave them, so that
nothing of an earlier store is computed again. Those keys have the hash of the data set as it was
ingested, in place of the hashes of single inputs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from typing import Any

from s2rstore.files import layout, safe_files
from s2rstore.geometry.camera_offset import RenderChange
from s2rstore.records import SIDES, Part, Run, Side
from s2rtools.counterfactual import gap_shares
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.precompute.depth_calibration import load_tolerance
from s2rtools.precompute.input_hashes import InputHashes

KEY_VERSION = 1

Facts = dict[str, Any]


def content_key(facts: Facts) -> str:
    """A short hash of plain facts, independent of the order of their names."""
    text = json.dumps({"version": KEY_VERSION, **facts}, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class ArrayKeys:
    """The keys of a run's arrays in one part of the data set."""

    def __init__(self, hashes: InputHashes, run: Run, part: Part) -> None:
        self._store, self._hashes, self._run, self._part = hashes.store, hashes, run, part
        records = self._store.array_parts(run.run)
        self._published = {tuple(record.path.split("/")[:2]) for record in records}

    def _key(self, facts: Facts, earlier: Facts) -> tuple[str, bool]:
        """The key of some facts, and whether it is new.

        The key of `earlier` facts is kept where arrays of it are published or begun.
        """
        key = content_key(earlier)
        folder = f"{layout.RUNS}/{self._run.run}/{key}"
        if (self._run.run, key) in self._published or (
            safe_files.kind(self._store.path, folder) is not None
        ):
            return key, False
        return content_key(facts), True

    def frames(self, side: Side, move: RenderChange, renderer: Any) -> tuple[str, bool]:
        """The key of rendered frames, and whether all runs share them."""
        domain, dataset = self._run.domain(side), self._store.dataset
        facts = {"domain": domain, "move": _move(move), "renderer": renderer, "kind": "frames"}
        inputs = {
            "frames": self._hashes.frames(domain, self._part),
            "poses": self._hashes.poses(self._part, domain),
            "cameras": self._hashes.cameras(domain),
            "size": [dataset.frame_height, dataset.frame_width],
        }
        return self._key({**facts, **inputs}, {**facts, "dataset": self._part.hash})

    def prediction(self, backend: Facts, rendered: Sequence[str]) -> str:
        """The key of predictions and embeddings; `rendered` are the keys of rendered frames."""
        facts = {"kind": "prediction", "backend": backend}
        inputs = {**self._images(rendered), **self._model, **self._source_sizes}
        return self._key({**facts, **inputs}, {**facts, **self._earlier})[0]

    def heatmap(self, name: str, backend: Facts, rendered: Sequence[str]) -> tuple[str, bool]:
        """The key of the arrays of a heatmap kind, and whether all runs share them."""
        kind = HEATMAP_KINDS[name]
        facts: Facts = {"kind": name, "version": kind.version, "params": kind.params}
        inputs = self._images(rendered)
        if not kind.model_free:
            inputs |= {**self._model, "backend": backend, **self._source_sizes}
        if kind.uses_truth:
            inputs["poses"] = self._poses
        earlier = {**self._earlier, "backend": backend}
        if kind.aligned:
            offset = self._store.rig_offset(self._run.sim_domain, self._run.real_domain)
            # Calibration estimates no pitch; the key has the entries that earlier versions wrote.
            facts["correction"] = offset and {"height": offset.height, "zoom": offset.zoom}
            inputs["cameras"] = self._cameras
        if kind.compares_depth:
            facts["tolerance"] = self._tolerance
        key, is_new = self._key({**facts, **inputs}, {**facts, **earlier})
        return key, is_new and kind.model_free

    def gap_shares(self, backend: Facts, rendered: Sequence[str]) -> str:
        """The key of the shares of the gap, which no earlier release computed."""
        offset = self._store.rig_offset(self._run.sim_domain, self._run.real_domain)
        return content_key(
            {
                "kind": gap_shares.KIND,
                "version": gap_shares.VERSION,
                "backend": backend,
                "correction": offset and asdict(offset),
                "tolerance": self._tolerance,
                "cameras": self._cameras,
                "poses": self._poses,
                **self._images(rendered),
                **self._model,
                **self._source_sizes,
            }
        )

    def map(self, heat: str, prediction: str, settings: Facts) -> str:
        """The key of the map grids of heatmaps, given by the keys of these and the predictions."""
        facts = {"heat": heat, **settings}
        inputs = {
            "prediction": prediction,
            "poses": self._poses,
            "cameras": self._cameras,
            "floor": self._hashes.floor(),
        }
        return self._key({**facts, **inputs}, facts)[0]

    @cached_property
    def _tolerance(self) -> Facts | None:
        tolerance = load_tolerance(self._store, self._run)
        return None if tolerance is None else asdict(tolerance)

    def _images(self, rendered: Sequence[str]) -> Facts:
        domains = self._run.sim_domain, self._run.real_domain
        return {
            "frames": [self._hashes.frames(domain, self._part) for domain in domains],
            "adjustments": [_without_names(self._run.adjustments(side)) for side in SIDES],
            "rendered": sorted(set(rendered)),
        }

    @cached_property
    def _poses(self) -> str:
        return self._hashes.poses(self._part, *(self._run.domain(side) for side in SIDES))

    @cached_property
    def _cameras(self) -> list[str]:
        return [self._hashes.cameras(self._run.domain(side)) for side in SIDES]

    @cached_property
    def _model(self) -> Facts:
        """Empty for imported predictions, whose key depends on their values alone."""
        if self._run.model is None:
            return {}
        model = self._store.models[self._run.model]
        facts = {
            "model": model.sha256,
            "architecture": model.architecture,
            "convention": model.convention,
        }
        return facts if model.input is None else {**facts, "input": model.input}

    @cached_property
    def _source_sizes(self) -> Facts:
        """The sizes of the images from which the input of networks is made.

        Empty where they are the stored frames.
        """
        first = self._part.first_iid
        sizes = [self._store.source_size(self._run.domain(side), first) for side in SIDES]
        return {"source": sizes} if any(sizes) else {}

    @cached_property
    def _earlier(self) -> Facts:
        """The inputs in the keys of predictions and heatmaps of releases up to 0.2.0."""
        sides: Facts = {
            side: [self._run.domain(side), _without_names(self._run.adjustments(side))]
            for side in SIDES
        }
        return {"dataset": self._part.hash, **self._model, **sides}


def _without_names(chain: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The chain without the names of translators, on which no value depends."""
    return [{**step, "name": "translate"} if "sha256" in step else step for step in chain]


def _move(move: RenderChange) -> Facts:
    """The offset of the cameras; lights only where they are changed, as earlier releases wrote."""
    facts = asdict(move)
    for light in ("lamps", "windows"):
        if facts[light] == 1:
            del facts[light]
    return facts
