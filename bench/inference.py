"""Predictions and embeddings against the bare forward pass, and against one image at a time."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

import s2rstore
from bench.budget import BudgetRow, seconds
from bench.measured_stores import frames_store, lively
from s2rstore.records import SIDES
from s2rtools.inference import choose_backend
from s2rtools.models.load_model import load_model
from s2rtools.precompute.frame_reader import read_pairs

_PAIRS = 32


def figures(threads: int) -> Iterator[BudgetRow]:
    """posest at 256 x 256; images per second with and without batches."""
    torch.set_num_threads(threads)
    folder = Path(tempfile.mkdtemp())
    try:
        path = frames_store(folder / "s.s2r", _PAIRS, 256, lively("posest"))
        with s2rstore.open(path) as store:
            yield from _measured(store, threads)
    finally:
        shutil.rmtree(folder)


def _measured(store: s2rstore.reader.Store, threads: int) -> Iterator[BudgetRow]:
    model = load_model(store, "m")
    run = store.run("r")
    batches = [f for _, f in read_pairs(store, run, model.contract, 0, _PAIRS, 8)]
    inputs = [batch[side].x for batch in batches for side in SIDES]
    images = sum(len(x) for x in inputs)
    sample = np.concatenate(inputs[:2])
    for name in ("torch", "auto"):
        backend = choose_backend(model, sample, name, threads).backend
        label = f"{name} ({backend.precision})"
        if name == "auto" and backend.name == "torch":
            yield BudgetRow("this machine has no faster backend that is close enough", 1, "")
            label = "auto (torch float32)"

        def bare(backend=backend) -> None:
            with torch.inference_mode():
                for x in inputs:
                    features = backend.features(torch.from_numpy(x))
                    model.network.head(model.network.embed(features))

        def whole(backend=backend) -> None:
            for x in inputs:
                backend.forward_all(x)

        def reading(backend=backend) -> None:
            for _, pair in read_pairs(store, run, model.contract, 0, _PAIRS, backend.batch):
                for side in SIDES:
                    backend.forward_all(pair[side].x)

        plain = images / seconds(bare, 3)
        alone, with_reading = images / seconds(whole, 3), images / seconds(reading, 3)
        yield BudgetRow(f"bare batched forward, {label}", plain, "images/s")
        yield BudgetRow(f"predictions + embeddings, {label}", alone, "images/s")
        yield BudgetRow(f"predictions + embeddings / bare, {label}", alone / plain, "ratio", 0.85,
                     "at least")  # fmt: skip
        yield BudgetRow(
            f"... with image reading / bare, {label}",
            with_reading / plain,
            "ratio",
            0.6,
            "at least",
        )
        preferred = alone

    def one_at_a_time() -> None:
        with torch.inference_mode():
            for x in inputs[:2]:
                for image in x:
                    model.network(torch.from_numpy(image[None]))

    single = sum(len(x) for x in inputs[:2]) / seconds(one_at_a_time, 3)
    yield BudgetRow("one image at a time, plain module", single, "images/s")
    yield BudgetRow(
        "preferred backend / one image at a time", preferred / single, "ratio", 6.0, "at least"
    )
