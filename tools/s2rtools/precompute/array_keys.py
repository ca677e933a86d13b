"""Keys of a run's arrays: hashes over everything that their values depend on, and nothing else."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from typing import Any

from s2rstore.geometry.camera_offset import RenderChange
from s2rstore.records import SIDES, Run, Side
from s2rtools.counterfactual import gap_shares
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.precompute.domain_calibration import load_tolerance
from s2rtools.precompute.input_hashes import InputHashes

KEY_VERSION = 1

Facts = dict[str, Any]


def content_key(facts: Facts) -> str:
    """A short hash of plain facts, independent of the order of their names."""
    text = json.dumps({"version": KEY_VERSION, **facts}, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class ArrayKeys:
    """The keys of a run's arrays for some instances, which are whole parts of the data set.

    `sides` are those of which the instances have images.
    """

    def __init__(
        self, hashes: InputHashes, run: Run, iids: range, sides: Sequence[Side] = SIDES
    ) -> None:
        self._store, self._hashes, self._run, self._iids = hashes.store, hashes, run, iids
        self._sides = sides

    def frames(self, side: Side, move: RenderChange, renderer: Any) -> str:
        """The key of rendered frames, which all runs share."""
        domain, dataset = self._run.domain(side), self._store.dataset
        return content_key(
            {
                "domain": domain,
                "move": _move(move),
                "renderer": renderer,
                "kind": "frames",
                "frames": self._hashes.frames(domain, self._iids),
                "poses": self._hashes.poses(self._iids, domain),
                "cameras": self._hashes.cameras(domain),
                "size": [dataset.frame_height, dataset.frame_width],
            }
        )

    def prediction(self, backend: Facts, rendered: Sequence[str]) -> str:
        """The key of predictions and embeddings; `rendered` are the keys of rendered frames."""
        inputs = {**self._images(rendered), **self._model, **self._source_sizes}
        return content_key({"kind": "prediction", "backend": backend, **inputs})

    def heatmap(self, name: str, backend: Facts, rendered: Sequence[str]) -> tuple[str, bool]:
        """The key of the arrays of a heatmap kind, and whether all runs share them."""
        kind = HEATMAP_KINDS[name]
        facts: Facts = {"kind": name, "version": kind.version, "params": kind.params}
        facts |= self._images(rendered)
        if not kind.model_free:
            facts |= {**self._model, "backend": backend, **self._source_sizes}
        if kind.uses_truth:
            facts["poses"] = self._poses
        if kind.aligned:
            offset = self._store.rig_offset(self._run.sim_domain, self._run.real_domain)
            # Calibration estimates no pitch.
            facts["correction"] = offset and {"height": offset.height, "zoom": offset.zoom}
            facts["cameras"] = self._cameras
        if kind.compares_depth:
            facts["tolerance"] = self._tolerance
        return content_key(facts), kind.model_free

    def gap_shares(self, backend: Facts, rendered: Sequence[str]) -> str:
        """The key of the shares of the gap."""
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
        return content_key({**facts, **inputs})

    @cached_property
    def _tolerance(self) -> Facts | None:
        tolerance = load_tolerance(self._store, self._run)
        return None if tolerance is None else asdict(tolerance)

    def _images(self, rendered: Sequence[str]) -> Facts:
        domains = [self._run.domain(side) for side in self._sides]
        return {
            "frames": [self._hashes.frames(domain, self._iids) for domain in domains],
            "adjustments": [_without_names(self._run.adjustments(side)) for side in self._sides],
            "rendered": sorted(set(rendered)),
        }

    @cached_property
    def _poses(self) -> str:
        return self._hashes.poses(self._iids, *(self._run.domain(side) for side in SIDES))

    @cached_property
    def _cameras(self) -> list[str]:
        return [self._hashes.cameras(self._run.domain(side)) for side in SIDES]

    @cached_property
    def _model(self) -> Facts:
        """Empty for imported predictions, whose key depends on their values alone."""
        if self._run.model is None:
            return {}
        model = self._store.models[self._run.model]
        return {
            "model": model.sha256,
            "architecture": model.architecture,
            "convention": model.convention,
            "input": model.input,
        }

    @cached_property
    def _source_sizes(self) -> Facts:
        """The sizes of the images from which the input of networks is made.

        Empty where they are the stored frames; a list where they differ between parts.
        """
        domains = [self._run.domain(side) for side in self._sides]
        sizes = [
            [self._store.source_size(domain, part.first_iid) for domain in domains]
            for part in self._store.trajectory_parts
            if part.first_iid in self._iids
        ]
        if all(of_part == sizes[0] for of_part in sizes):
            return {"source": sizes[0]} if any(sizes[0]) else {}
        return {"source": sizes}


def _without_names(chain: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The chain without the names of translators, on which no value depends."""
    return [{**step, "name": "translate"} if "sha256" in step else step for step in chain]


def _move(move: RenderChange) -> Facts:
    """The offset of the cameras; lights only where they are changed."""
    facts = asdict(move)
    for light in ("lamps", "windows"):
        if facts[light] == 1:
            del facts[light]
    return facts
