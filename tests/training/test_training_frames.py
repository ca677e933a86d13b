"""Training images outside of memory: same values, and only those that a training needs."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.models.input_contract import InputContract
from s2rtools.models.preprocessing import preprocess
from s2rtools.training import Budget, CopiedFrames, StreamedFrames, TrainingFrames, train
from s2rtools.training.train_into_store import TrainingRequest, train_into_store
from s2rtools.training.training_frames import DiskArray

N, CONTRACT, ACCEPTED = 70, InputContract(size=(24, 24)), InputContract(size=(128, 128))


@pytest.fixture(scope="module")
def images() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (N, 128, 128, 3), dtype=np.uint8)
    return rgb, rng.integers(0, 9000, (N, 128, 128), dtype=np.uint16)


def blocks(images: tuple[np.ndarray, np.ndarray], rows: int = 16):
    rgb, depth = images
    return ((rgb[k : k + rows], depth[k : k + rows]) for k in range(0, N, rows))


@pytest.mark.parametrize("rows", [[5], [69, 0, 33, 33], list(range(20, 50)), []])
def test_copied_and_streamed_frames_are_those_in_memory(images, rows, tmp_path: Path) -> None:
    rgb, depth = images
    copied = CopiedFrames.from_blocks("sim", blocks(images), N, CONTRACT, 0.001, tmp_path)
    streamed = StreamedFrames("sim", lambda a, b: [(rgb[a:b], depth[a:b])], CONTRACT, 0.001)
    expected = preprocess(rgb[rows], depth[rows], 0.001, CONTRACT)
    chosen = np.array(rows, dtype=np.intp)
    assert np.array_equal(copied.inputs(chosen), expected)
    assert np.array_equal(streamed.inputs(chosen), expected)
    assert not list(tmp_path.iterdir())  # the copies have no names


def test_neighbouring_rows_are_read_together(images) -> None:
    rgb, depth = images
    reads = []

    def read(start: int, stop: int) -> list[tuple[np.ndarray, np.ndarray]]:
        reads.append((start, stop))
        return [(rgb[start:stop], depth[start:stop])]

    StreamedFrames("sim", read, CONTRACT, 0.001).inputs(np.array([3, 4, 5, 9, 2, 3]))
    assert reads == [(3, 6), (9, 10), (2, 4)]


def test_copies_give_the_same_weights_as_images_in_memory(images, tmp_path: Path) -> None:
    in_memory = CopiedFrames("sim", *images, 0.001, ACCEPTED)
    copied = CopiedFrames.from_blocks("sim", blocks(images), N, ACCEPTED, 0.001, tmp_path)
    poses = np.random.default_rng(1).uniform(0, 3, (N, 3))
    weights = []
    for frames in (in_memory, copied):
        given = TrainingFrames({"sim": frames}, poses, np.zeros(N, dtype=np.int32))
        weights.append(train(given, "vanilla", budget=Budget(steps=2)).network.state_dict())
    assert weights[0].keys() == weights[1].keys()
    assert all((weights[0][name] == weights[1][name]).all() for name in weights[0])


def test_a_full_disk_is_an_error_that_names_the_folder(tmp_path: Path) -> None:
    array = DiskArray((4,), np.dtype(np.uint8), tmp_path)

    class Full:
        def write(self, content: object) -> None:
            raise OSError(28, "No space left on device")

    array._file = Full()
    with pytest.raises(RequestError, match=rf"{tmp_path}: .*No space left"):
        array.append(np.zeros((2, 4), dtype=np.uint8))
    with pytest.raises(IndexError):
        array[np.array([0])]


def test_every_domain_that_is_needed_is_read_once(
    store_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Training passes read the copies, however many steps there are."""
    reads: Counter[tuple[str, int]] = Counter()
    frames = Store.frames

    def counted(store: Store, domain: str, start: int, stop: int, *more: object) -> object:
        reads.update((domain, row) for row in range(start, stop))
        return frames(store, domain, start, stop, *more)

    monkeypatch.setattr(Store, "frames", counted)
    with Store(store_copy) as store:
        count, kinds = len(store.instances), {d: each.kind for d, each in store.domains.items()}
    train_into_store(store_copy, TrainingRequest("vanilla", name="v", steps=3), print, "s2r train")
    used = {domain for domain, kind in kinds.items() if kind == "sim"} | {"real"}
    assert reads == {(domain, row): 1 for domain in used for row in range(count)}
