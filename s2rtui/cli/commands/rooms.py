"""`s2r rooms`: list the rooms of a store, or rename one."""

from __future__ import annotations

import argparse

import s2rstore
from s2rtools.common.command_line import output, store_argument

_NAMES = ("room", "instances", "area m2")
EXAMPLE = "s2r rooms lab.s2r --rename Room_3 kitchen"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--rename", nargs=2, metavar=("OLD", "NEW"),
                        help="give a room another name; computed results stay valid")  # fmt: skip
    output.add_output_options(parser)


def execute(options: argparse.Namespace) -> int:
    if options.rename:
        from s2rstore.maintenance.room_names import rename_room

        old, new = options.rename
        count = rename_room(options.store, old, new)
        print(f"{options.store}: room {old} is now {new} ({count} instances)")
        return 0
    with s2rstore.open(options.store) as store:
        truth, areas = store.instances, dict.fromkeys(store.stored_rooms, 0.0)
        for room in store.rooms:
            areas[room.room] += (room.x1 - room.x0) * (room.y1 - room.y0)
        codes = truth.room.tolist()
        counts = {name: codes.count(code) for code, name in enumerate(truth.room_names)}
        table = [(name, counts.get(name, 0), round(area, 2)) for name, area in areas.items()]
    output.write(_NAMES, table, options)
    return 0
