"""Factor `objects`: changes of the scene since it was scanned."""

from __future__ import annotations

from s2rtools.synthetic_world.factors.factor import Factor


class Objects(Factor):
    """The first share of the world's changes, all of them from severity 1 on. `World` applies it,
    because only it knows both positions of an object.
    """

    name = "objects"
    description = "objects removed, added, moved, doors closed"
    shapes_scene = True
