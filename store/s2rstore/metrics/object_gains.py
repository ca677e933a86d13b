"""What labelled objects cost the real prediction: gains per class over some instances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.intervals import Interval
from s2rstore.reader import Store
from s2rstore.records import needs_network
from s2rstore.security.printable_text import printable

CLAIM = 0.25
"""Metres from which an object counts as harmful in an image."""


@dataclass(frozen=True, slots=True)
class ObjectGain:
    """By how many metres the real error would fall if the objects of a class were as in simulation.

    `gain` is the mean over the images that show the class; its interval holds for all classes at
    once. `images` of the instances show it, in `harmed` of them it costs more than `CLAIM`;
    `total` is the sum over all images.
    """

    name: str
    gain: Interval
    images: int
    harmed: int
    total: float


@dataclass(frozen=True, slots=True)
class ObjectGains:
    """The classes that some instances show, by their mean gain, the largest first.

    `n` instances have a label image and a gain; `error` is the mean real error over them. Without
    `has_sim_labels`, what an object costs that is missing in reality counts for what is behind it.
    """

    n: int
    error: float
    classes: tuple[ObjectGain, ...]
    has_sim_labels: bool


def missing_gains(store: Store, run: str) -> str:
    """Why a run has no gains of objects, and what to do; empty where it has some."""
    if store.execute("SELECT 1 FROM label_gain WHERE run = ? LIMIT 1", [run]):
        return ""
    if not store.label_names:
        return "no label images name the objects; `s2r labels import` adds them"
    if store.run(run).is_imported:
        return needs_network(run, "harm")
    if any(record.kind == "harm" for record in store.array_kinds(run)):
        return "no pair of this run shows a labelled object"
    return "no gains of objects for this run; `s2r precompute --kinds harm` computes them"


def instance_gains(store: Store, run: str, iid: int) -> list[tuple[str, float]]:
    """The gain of each class in the real image of one instance, metres, the largest sizes first."""
    query = """SELECT name, sum(gain) FROM label_gain JOIN label USING (label)
               WHERE run = ? AND iid = ? GROUP BY name ORDER BY abs(sum(gain)) DESC, name"""
    return [(printable(name), gain) for name, gain in store.execute(query, [run, iid])]


def object_gains(store: Store, run: str, chosen: NDArray[np.bool_]) -> ObjectGains | None:
    """Gains of the classes over the chosen instances (N,) of a run; None where none has any."""
    names = dict.fromkeys(store.label_names.values())
    columns = store.run_columns(run)
    gains = {name: np.where(chosen, columns.label_gains(name), np.nan) for name in names}
    shown = {name: values for name, values in gains.items() if np.isfinite(values).any()}
    if not shown:
        return None
    level = intervals.simultaneous_level(len(shown))
    classes = [_gain(store, name, values, level) for name, values in shown.items()]
    rows = np.isfinite(np.stack([*shown.values()])).any(axis=0)
    error = float(np.nanmean(columns.real.error[rows]))
    ordered = sorted(classes, key=lambda each: -each.gain.value)
    has_sim_labels = store.run(run).sim_domain in store.label_keys
    return ObjectGains(int(np.count_nonzero(rows)), error, tuple(ordered), has_sim_labels)


def _gain(store: Store, name: str, values: NDArray[np.float64], level: float) -> ObjectGain:
    rows = store.in_recording_order(np.isfinite(values))
    of_images = values[rows]
    mean = intervals.paired_difference(of_images, store.instances.trajectory[rows], level=level)
    harmed = int(np.count_nonzero(of_images > CLAIM))
    return ObjectGain(name, mean, rows.size, harmed, float(of_images.sum()))
