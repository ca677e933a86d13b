"""What the store knows of heatmaps without loading the tools."""

from __future__ import annotations

from s2rstore.reader import NETWORK_KINDS
from s2rtools.heatmaps import HEATMAP_KINDS, IMAGE_KINDS


def test_the_store_knows_the_kinds_that_need_a_network() -> None:
    assert HEATMAP_KINDS.keys() - IMAGE_KINDS.keys() == NETWORK_KINDS
    assert IMAGE_KINDS.keys() == {name for name, kind in HEATMAP_KINDS.items() if kind.model_free}
