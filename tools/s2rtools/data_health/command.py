"""`s2r check`: faults of the images, poses and times of a store."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

import s2rstore
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.progress import reporter

if TYPE_CHECKING:
    from s2rtools.data_health.faults import Fault

EXAMPLE = "s2r check lab.s2r --domain real"
_NAMES = ("fault", "domain", "n", "share", "meaning", "instances")
_SHOWN = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("--domain", action="append", default=[],
                        help="check only this domain (repeatable; default: all)")  # fmt: skip
    parser.add_argument("--strict", action="store_true",
                        help="exit with 1 where there is a fault")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON with all instances")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.data_health.faults import check_store

    with s2rstore.open(options.store) as store, reporter() as progress:
        domains = options.domain or list(store.domains)
        found = check_store(store, domains, progress)
        count = len(store.instances)
    if options.json:
        json.dump([fault.as_json() for fault in found], sys.stdout, indent=1)
        sys.stdout.write("\n")
    elif found:
        print(output.table(_NAMES, [_row(fault) for fault in found]), end="")
        print("\n--json prints expressions that select the instances")
    else:
        print(f"{count} instances, domains {', '.join(domains)}: no fault found")
    return 1 if found and options.strict else 0


def _row(fault: Fault) -> tuple[object, ...]:
    ranges = fault.ranges()
    more = f" and {len(ranges) - _SHOWN} more" if len(ranges) > _SHOWN else ""
    listed = f"{', '.join(ranges[:_SHOWN])}{more}"
    return (fault.name, fault.domain, fault.iids.size, f"{fault.share:.1%}", fault.meaning, listed)
