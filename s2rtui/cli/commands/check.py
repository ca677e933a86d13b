"""`s2r check`: find faults of the images, poses and times of a store, and record them there."""

from __future__ import annotations

import argparse
import json
import shutil
import sys

import numpy as np

import s2rstore
from s2rstore.index.transaction import check_writable
from s2rstore.remote.store_url import StoreUrl
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import reporter

EXAMPLE = "s2r check lab.s2r --domain real"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("--domain", action="append", default=[],
                        help="check only this domain (repeatable; default: all)")  # fmt: skip
    parser.add_argument("--dry-run", action="store_true",
                        help="print the faults without recording them in the store")  # fmt: skip
    parser.add_argument("--strict", action="store_true",
                        help="exit with 1 where there is a fault")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON with all instances")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.data_health.faults import check_store, record_faults
    from s2rtui.analysis.binning import Bools
    from s2rtui.charts.health import FoundFaults, health_notes, health_table
    from s2rtui.drawing.cells import text_lines
    from s2rtui.drawing.drawing import Drawing

    is_recorded = not options.dry_run and not isinstance(options.store, StoreUrl)
    if is_recorded:
        check_writable(options.store)
    with s2rstore.open(options.store) as store, reporter() as progress:
        domains = list(dict.fromkeys(options.domain or store.domains))
        found = check_store(store, domains, progress)
        count = len(store.instances)
        masks: dict[str, dict[str, Bools]] = {domain: {} for domain in domains}
        for fault in found:
            masks[fault.domain][fault.name] = fault.mask(count)
        images = {domain: int(store.imaged(domain).sum()) for domain in domains}
        model = FoundFaults.of(masks, images, np.ones(count, dtype=np.bool_))
    if is_recorded:
        record_faults(options.store, domains, found, count)
    if options.json:
        json.dump([fault.as_json() for fault in found], sys.stdout, indent=1)
        sys.stdout.write("\n")
    else:
        table = health_table(model, with_selected=False) if found else None
        drawing = Drawing(table=table, notes=health_notes(model))
        print("\n".join(text_lines(drawing, shutil.get_terminal_size().columns)))
        if found:
            how = "--json prints expressions that select"
            print(f"\n{'`health:NAME` selects' if is_recorded else how} the images of a fault")
    return 1 if found and options.strict else 0
