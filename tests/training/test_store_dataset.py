"""A data set of torch gives the images, depths and poses of a store, in several processes."""

import gc

import numpy as np
import pytest
from torch.utils.data import ConcatDataset, DataLoader, get_worker_info

import s2rstore
from s2rstore.index.transaction import edit
from s2rtools.training.splits import TEST, TRAIN, split_by_blocks
from s2rtools.training.store_dataset import StoreDataset
from tests.support.refusals import refused


def released(sample):
    if get_worker_info() is not None:
        gc.collect()  # destroys what the fork left unused
    return sample


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.deep)])
def test_batches_hold_what_the_store_holds(store_copy, workers):
    parts = [StoreDataset(store_copy, "sim", None, f"traj:{name}", released) for name in "ab"]
    with edit(store_copy):  # workers open another generation than this process
        pass
    loader = DataLoader(ConcatDataset(parts), 8, num_workers=workers, timeout=30 * workers)
    samples = [
        {name: batch[name][place] for name in batch}
        for batch in loader
        for place in range(len(batch["iid"]))
    ]
    with s2rstore.open(store_copy) as store:
        for iid, sample in enumerate(samples):
            frame, scale = store.frame("sim", iid), store.domain("sim").depth_scale
            assert sample["iid"] == iid
            assert np.allclose(255 * sample["image"].numpy().transpose(1, 2, 0), frame.rgb)
            assert np.allclose(sample["pose"], store.poses("sim")[iid])
            expected = np.where(frame.valid, frame.depth * scale, np.nan)
            assert np.allclose(sample["depth"], expected, equal_nan=True)
    assert len(samples) == 40


def test_splits_are_those_of_training_and_transforms_are_applied(tiny_store):
    with s2rstore.open(tiny_store) as store:
        codes = split_by_blocks(store.instances.trajectory)
    for name, code in (("train", TRAIN), ("test", TEST)):
        found = StoreDataset(tiny_store, "sim", name).iids
        assert np.array_equal(found, np.flatnonzero(codes == code))
    iids = StoreDataset(tiny_store, "real", transform=lambda sample: sample["iid"])
    assert (iids[0], iids[39]) == (0, 39)
    for domain, split in (("nowhere", None), ("sim", "unseen")):
        with refused(match="nowhere|unseen"):
            StoreDataset(tiny_store, domain, split)
