"""The outputs that README and tutorial show are those of the demo."""

from __future__ import annotations

import importlib.util
import re
from itertools import zip_longest
from pathlib import Path

import pytest

from s2rtui.cli import main

ROOT = Path(__file__).resolve().parent.parent.parent
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e-?\d+)?")


@pytest.mark.deep
def test_shown_outputs_are_those_of_the_demo(tmp_path):
    """Words are equal, and numbers but for the last digits, in which processors differ."""
    spec = importlib.util.spec_from_file_location("outputs", ROOT / "docs" / "update_outputs.py")
    outputs = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(outputs)
    assert main(["demo", "--out", str(tmp_path / "demo"), "--no-open"]) == 0
    compared = 0
    for page in outputs.PAGES:
        for block in outputs._BLOCK.finditer(page.read_text(encoding="utf-8")):
            fresh = outputs.output(block["command"], tmp_path / "demo" / "world.s2r")
            for shown, printed in zip_longest(block["output"].splitlines(), fresh.splitlines()):
                where = f"{page.name}, {block['command']}: {shown!r} against {printed!r}"
                assert shown is not None, where
                assert printed is not None, where
                assert _words(shown) == _words(printed), where
                numbers = [list(map(float, _NUMBER.findall(line))) for line in (shown, printed)]
                assert numbers[0] == pytest.approx(numbers[1], rel=0.02, abs=0.02), where
            compared += 1
    assert compared >= 3


def _words(line: str) -> list[str]:
    return re.sub(r"-{2,}", "-", _NUMBER.sub("0", line)).split()
