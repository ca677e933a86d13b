"""Replace the pictures of the gallery by those of the demo store.

    python docs/update_gallery.py demo-out/world.s2r [VIEW ...]

Every view, or those that are named, fills a screen of 100 x 30 with the worst 15 % selected. The
demo has no faults and no measured nights: `health` and `history` are drawn of other stores, which
`s2r check` and `s2r nightly` have filled, and only where they are named. Look at the pictures
before you keep them.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from s2rtui.charts.registry import VIEWS

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "assets" / "views"
KEYS = {"adjust": ["right"], "exchange": ["c"], "health": ["c"], "recall": ["c"], "risk": ["c"]}
"""Further keys of some views, before the one that fills the screen."""
OTHER_STORES = ("health", "history")


def main() -> None:
    """Write a picture for each view."""
    PICTURES.mkdir(exist_ok=True)
    store, chosen = Path(sys.argv[1]).resolve(), sys.argv[2:]
    names = chosen or [view.name for view in VIEWS if view.name not in OTHER_STORES]
    for view in (view for view in VIEWS if view.name in names):
        keys = ["w", view.key, *KEYS.get(view.name, []), "V"]
        out = PICTURES / f"{view.name}.png"
        command = [sys.executable, "-m", "s2rtui", "snapshot", store.name, "--size", "100x30",
                   "--keys", ",".join(keys), "--out", str(out)]  # fmt: skip
        subprocess.run(command, cwd=store.parent, check=True)
        print(f"{out.relative_to(ROOT)}: {out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
