"""A data set of torch gives the images, depths and poses of a store, in several processes."""

import numpy as np
import pytest
from torch.utils.data import DataLoader

import s2rstore
from s2rtools.training.splits import TEST, TRAIN, split_by_blocks
from s2rtools.training.store_dataset import StoreDataset
from tests.support.refusals import refused


@pytest.mark.parametrize("workers", [0, 2])
def test_batches_hold_what_the_store_holds(tiny_store, workers):
    found = StoreDataset(tiny_store, "sim", select="traj:a")
    with s2rstore.open(tiny_store) as store:
        truth, domain = store.instances, store.domain("sim")
        seen = []
        for batch in DataLoader(found, batch_size=8, num_workers=workers):
            for place, iid in enumerate(batch["iid"].tolist()):
                frame = store.frame("sim", iid)
                image = batch["image"][place].numpy().transpose(1, 2, 0)
                assert np.allclose(255 * image, frame.rgb)
                pose = truth.x[iid], truth.y[iid], truth.heading[iid]
                assert batch["pose"][place].tolist() == pytest.approx(pose, rel=1e-6)
                metres = batch["depth"][place].numpy()
                assert np.array_equal(np.isfinite(metres), frame.valid)
                expected = frame.depth[frame.valid] * domain.depth_scale
                assert np.allclose(metres[frame.valid], expected)
                seen.append(iid)
    assert seen == list(range(25))
    found.close()


def test_splits_are_those_of_training_and_transforms_are_applied(tiny_store):
    parts = {name: StoreDataset(tiny_store, "sim", name) for name in ("train", "test")}
    with s2rstore.open(tiny_store) as store:
        codes = split_by_blocks(store.instances.trajectory)
    for name, code in (("train", TRAIN), ("test", TEST)):
        assert np.array_equal(parts[name].iids, np.flatnonzero(codes == code))
    iids = StoreDataset(tiny_store, "real", transform=lambda sample: sample["iid"])
    assert [iids[place] for place in (0, 39)] == [0, 39]
    for domain, split in (("nowhere", None), ("sim", "unseen")):
        with refused(match="nowhere|unseen"):
            StoreDataset(tiny_store, domain, split)
