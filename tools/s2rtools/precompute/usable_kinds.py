"""What can be computed of a run whose pairs are loose, or whose domains have no depth."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rtools.heatmaps import HEATMAP_KINDS


def domains_without_depth(store: Store, run: Run) -> list[str]:
    """The domains of a run that have no depth, each once."""
    domains = dict.fromkeys(run.domain(side) for side in SIDES)
    return [domain for domain in domains if not store.domain(domain).has_depth]


def usable_kinds(
    store: Store, run: Run, kinds: Sequence[str], report_line: Callable[[str], object]
) -> Sequence[str]:
    """The heatmap kinds that the run's domains have depth for.

    `report_line` is called with a line about what is left out, and with one about kinds that
    compare images of other poses. Raises RequestError where the model takes depth that a domain
    does not have.
    """
    without = domains_without_depth(store, run)
    if run.model is not None and store.models[run.model].channels != "rgb":
        store.require_depth(without, f"model {run.model}")
    usable = [kind for kind in kinds if not (without and HEATMAP_KINDS[kind].aligned)]
    if without:
        left_out = [kind for kind in kinds if kind not in usable]
        more = f", no {', '.join(left_out)}" if left_out else ""
        report_line(
            f"{run.run}: no depth in {' and '.join(without)}: no heat of that side on the map, no "
            f"heatmap modes of depth{more}"
        )
    compared = [kind for kind in usable if HEATMAP_KINDS[kind].compares_images]
    if store.has_loose_pairs and compared:
        truth = store.instances
        report_line(
            f"{run.run}: the images of a pair are {np.median(truth.pair_offset_m):.2f} m and "
            f"{np.median(truth.pair_offset_deg):.1f} degrees apart in the median; "
            f"{', '.join(compared)} compare{'s' if len(compared) == 1 else ''} them all the same"
        )
    return usable
