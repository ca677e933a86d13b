"""`s2r labels`: store which object each pixel of the frames shows."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

from s2rstore.errors import counted
from s2rstore.reader import Store
from s2rtools.common.command_line import store_argument

EXAMPLE = "s2r labels import lab.s2r masks/ --classes classes.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    tasks = parser.add_subparsers(metavar="TASK", title="tasks", dest="task", required=True)
    task = tasks.add_parser("import", help="import label images, and measure what objects cost")
    task.add_argument("store", type=store_argument.folder, help="store folder")
    task.add_argument("path", type=Path, metavar="FOLDER",
                      help="folder of PNG files of one channel, named by the ingested images or by "
                      "the numbers of the instances; or a COCO file (.json)")  # fmt: skip
    task.add_argument("--classes", type=Path, metavar="FILE",
                      help="CSV file with the columns id,name: the class of each value of the "
                      "pixels; 0 is unlabelled (or ScanNet's table, .tsv)")  # fmt: skip
    task.add_argument("--domain", help="domain of the labelled images (default: the real one)")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.labels.label_sources import LabelSource, read_source
    from s2rtools.labels.write_labels import write_labels
    from s2rtools.precompute.run_registration import find_domain

    def open_source(store: Store) -> LabelSource:
        return read_source(store, domain, options.path, options.classes)

    with Store(options.store) as store:
        domain = options.domain or find_domain(store, "real", None)
    stored = write_labels(options.store, domain, open_source, shlex.join(["s2r", *sys.argv[1:]]))
    images, labels = counted(stored.images, "label image"), counted(stored.labels, "label")
    print(f"{options.store}: {images} of {domain}, {labels}")
    if stored.runs:
        print(f"gains of objects computed for {', '.join(stored.runs)}; `s2r objects` lists them")
    elif stored.has_gains:
        print("the gains of objects are those that the store has; `s2r objects` lists them")
    else:
        print("no run has the heatmap harm; `s2r precompute --kinds harm` computes it")
    return 0
