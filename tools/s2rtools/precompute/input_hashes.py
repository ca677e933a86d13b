"""Hashes of the inputs of a store's arrays, each kind of input apart.

The key of an array has the hashes of those inputs alone that its values depend on. So nothing is
computed again because a room has another name, and only map grids where the floor has other bounds.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Any

import numpy as np

from s2rstore.reader import Store

_FRAMES = """
    SELECT count(*), sha256(string_agg(sha256, ' ' ORDER BY iid)) FROM frame
    WHERE domain = ? AND iid >= ? AND iid < ?
"""


class InputHashes:
    """Hashes of the inputs of one generation of a store; each is computed once."""

    def __init__(self, store: Store, earlier: InputHashes | None = None) -> None:
        """`earlier` are those of an earlier generation, used if the data set is the same."""
        self.store = store
        self._known: dict[tuple[str, str, range], str] = {}
        self._dataset = store.dataset, store.parts, store.domains
        if earlier is not None and earlier._dataset == self._dataset:
            self._known = earlier._known

    def frames(self, domain: str, iids: range) -> str:
        """The images of some instances in a domain, as stored, and what gives depth its unit."""
        key = "frames", domain, iids
        if key not in self._known:
            dataset, record = self.store.dataset, self.store.domain(domain)
            rows = self.store.execute(_FRAMES, [domain, iids.start, iids.stop])
            size = dataset.frame_height, dataset.frame_width
            depth = record.depth_scale, record.depth_raw_min, record.depth_raw_max
            self._known[key] = _digest([*rows[0], size, depth])
        return self._known[key]

    def poses(self, iids: range, *domains: str) -> str:
        """The ground truth of some instances, and of their frames with other poses."""
        own = [
            domain
            for domain in domains
            if domain in self.store.domains_with_own_poses
            and self.store.has_own_poses(domain, iids.start, iids.stop)
        ]
        key = "poses", "|".join(own), iids
        if key not in self._known:
            truth = self.store.instances
            columns = [truth.x, truth.y, truth.heading]
            columns += [column for domain in own for column in self.store.poses(domain).T]
            rows = np.stack([column[iids.start : iids.stop] for column in columns])
            content = rows.astype("<f8").tobytes()
            self._known[key] = hashlib.sha256(content).hexdigest()
        return self._known[key]

    def cameras(self, domain: str) -> str:
        """The cameras of a domain, without its name and the origin of its figures."""
        facts = self.store.domain(domain).facts()
        return _digest({k: v for k, v in facts.items() if k not in ("domain", "kind", "sources")})

    def floor(self) -> str:
        """The bounds of the floor and the direction of its y axis."""
        return _digest([asdict(self.store.dataset.bounds), self.store.dataset.y_down])


def _digest(facts: Any) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
