"""Which heatmap kinds are computed of a run: by its predictions, images and model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rtools.heatmaps import HEATMAP_KINDS, IMAGE_KINDS
from s2rtools.models.pose_network import LoadedModel


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


def kinds_without_network(
    name: str, kinds: Sequence[str], say: Callable[[str], None]
) -> tuple[str, ...]:
    """Those of the heatmap kinds that need no network; reports the others."""
    others = [kind for kind in kinds if kind not in IMAGE_KINDS]
    if others:
        say(f"{name}: imported predictions; {', '.join(others)} left out (no network)")
    return tuple(kind for kind in kinds if kind in IMAGE_KINDS)


def default_kinds(
    store: Store,
    run: str,
    model: LoadedModel,
    kinds: Sequence[str],
    say: Callable[[str], None],
) -> list[str]:
    """Those kinds that are computed where none are named; `say` reports the others.

    A kind that the run has already is computed for new instances, too.
    """
    published = {record.kind for record in store.array_parts(run)}
    usual = [k for k in kinds if k in published or HEATMAP_KINDS[k].is_default(model)]
    left_out = [kind for kind in kinds if kind not in usual]
    if left_out:
        say(
            f"{run}: {', '.join(left_out)} left out, which take long for inputs of "
            f"{model.contract.size[1]} x {model.contract.size[0]}; "
            f"--kinds {','.join(left_out)} adds them"
        )
    return usual
