"""Remove or report the building folders that interrupted ingests have left."""

from __future__ import annotations

import os
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

from s2rstore.building_folder import building_folders

Say = Callable[[str], object]


def remove_leftovers(target: Path, say: Say) -> None:
    """Remove building folders of ended processes of this host, and list the others.

    Folders of living processes and of other hosts stay. `say` gets a line for each folder.
    """
    for folder in building_folders(target):
        own = folder.process == os.getpid()
        if folder.is_of_this_host and (own or folder.is_abandoned):
            shutil.rmtree(folder.path, ignore_errors=True)
            if not folder.path.exists():
                say(
                    f"{folder.path}: removed; an interrupted ingest (process {folder.process}) "
                    "had left it"
                )
                continue
        builder = f"process {folder.process}"
        if folder.host is not None and not folder.is_of_this_host:
            builder += f" on {folder.host}"
        say(
            f"{folder.path}: left by another ingest ({builder}); "
            f"when that has ended, remove it with: rm -r {shlex.quote(str(folder.path))}"
        )
