"""`s2r check`: find faults of images, poses and times in a store or a recording."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import check_writable
from s2rstore.remote.open_files import store_path
from s2rstore.remote.store_url import StoreUrl, is_url
from s2rtools.common.command_line.progress import reporter

if TYPE_CHECKING:
    from s2rtools.data_health.faults import Fault

EXAMPLE = "s2r check lab.s2r --domain real"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", metavar="STORE|LAYOUT:PATH",
                        help="store folder, the URL of a store, or a recording that is not "
                        "ingested, such as tum:PATH")  # fmt: skip
    parser.add_argument("--domain", action="append", default=[],
                        help="check only this domain of the store (repeatable; default: "
                        "all)")  # fmt: skip
    parser.add_argument("--option", action="append", default=[], metavar="KEY=VALUE",
                        help="option of the layout of a recording (repeatable)")  # fmt: skip
    parser.add_argument("--dry-run", action="store_true",
                        help="print the faults without recording them in the store")  # fmt: skip
    parser.add_argument("--strict", action="store_true",
                        help="exit with 1 where there is a fault")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON with all instances")


def execute(options: argparse.Namespace) -> int:
    found, is_recorded = _check_recording(options), False
    if found is None:
        found, is_recorded = _check_store(options)
    if options.json:
        json.dump(found.rows, sys.stdout, indent=1)
        sys.stdout.write("\n")
    else:
        _print(found)
        if found.faults:
            how = "`health:NAME` selects" if is_recorded else "--json lists"
            print(f"\n{how} the images of a fault")
    return 1 if found.faults and options.strict else 0


@dataclass(frozen=True, slots=True, eq=False)
class _Checked:
    """Faults with their rows of JSON, the number of images by domain, and that of instances."""

    faults: Sequence[Fault]
    images: Mapping[str, int]
    count: int
    rows: Sequence[Mapping[str, Any]]


def _check_store(options: argparse.Namespace) -> tuple[_Checked, bool]:
    """Check a store, and record the faults unless it is on a server or nothing may be changed."""
    from s2rtools.data_health.faults import check_store, record_faults

    path = store_path(options.store)
    if options.option:
        raise RequestError("--option: only a recording LAYOUT:PATH has options")
    is_recorded = not options.dry_run and not isinstance(path, StoreUrl)
    with s2rstore.open(path) as store, reporter() as progress:
        if is_recorded:
            check_writable(path)
        domains = list(dict.fromkeys(options.domain or store.domains))
        found = check_store(store, domains, progress)
        count = len(store.instances)
        images = {domain: int(store.imaged(domain).sum()) for domain in domains}
    if is_recorded:
        record_faults(path, images, found)
    return _Checked(found, images, count, [fault.as_json() for fault in found]), is_recorded


def _check_recording(options: argparse.Namespace) -> _Checked | None:
    """Check a recording; None where the argument names none."""
    layout, separator, path = options.store.partition(":")
    if not separator or is_url(options.store) or Path(options.store).exists():
        return None
    from s2rtools.datasets.layouts import LAYOUTS
    from s2rtools.datasets.pair_arguments import read_recording
    from s2rtools.datasets.recording_faults import image_names, recording_faults

    if layout not in LAYOUTS:
        raise RequestError(f"{options.store}: no layout {layout!r}; one of {', '.join(LAYOUTS)}")
    if options.domain:
        raise RequestError("--domain: a recording has none")
    recording = read_recording("", f"{layout}:{path}", options.option, (), False)
    with reporter() as progress:
        found = recording_faults(recording, progress)
    names = image_names(recording)
    rows = [{**fault.as_json(), "images": [names[iid] for iid in fault.iids]} for fault in found]
    for row in rows:
        del row["expression"]
    return _Checked(found, {recording.name: len(names)}, len(names), rows)


def _print(checked: _Checked) -> None:
    from s2rtui.analysis.binning import Bools
    from s2rtui.charts.health import FoundFaults, health_notes, health_table
    from s2rtui.drawing.cells import text_lines
    from s2rtui.drawing.drawing import Drawing

    masks: dict[str, dict[str, Bools]] = {domain: {} for domain in checked.images}
    for fault in checked.faults:
        masks[fault.domain][fault.name] = fault.mask(checked.count)
    everything = np.ones(checked.count, dtype=np.bool_)
    model = FoundFaults.of(masks, checked.images, everything)
    table = health_table(model, with_selected=False) if checked.faults else None
    drawing = Drawing(table=table, notes=health_notes(model))
    print("\n".join(text_lines(drawing, shutil.get_terminal_size().columns)))
