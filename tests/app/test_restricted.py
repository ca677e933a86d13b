"""A restricted session on a store with an adjusted run imports no tools and labels its images."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from bench.support.screen import Screen
from s2rstore.index.transaction import edit
from s2rtools.adjustments import parse_adjustment


def test_an_adjusted_run_shows_its_unadjusted_images(store_copy: Path, tmp_path: Path) -> None:
    with edit(store_copy) as draft:
        adjusted = {"real_adjustments": json.dumps(parse_adjustment("real:brightness=1.5")["real"])}
        draft.update("run", {"run": "dataaug"}, adjusted)
    environment = {
        "XDG_DATA_HOME": str(tmp_path / "share"),
        "PYTHONPATH": ":".join(path for path in sys.path if path),
    }
    command = [sys.executable, "-m", "s2rtui", "tui", "--restricted", "--run", "dataaug"]
    screen = Screen([*command, str(store_copy)], (120, 40), environment)
    try:
        screen.wait_for("any key begins")
        screen.press("\x1b")
        screen.wait_for("run dataaug")
        screen.wait_for("before")
        screen.press("a")
        screen.wait_for("not in a restricted session")
        screen.press("r")
        screen.wait_for("run vanilla")
        screen.wait_for(lambda text: "before" not in text)
        screen.press("q")
        assert screen.wait_for_end() == 0
        assert b"Traceback" not in screen.raw
    finally:
        screen.close()
