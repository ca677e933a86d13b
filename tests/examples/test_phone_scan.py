"""The how-to page on phone scans, with fewer images, steps and heatmaps."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from examples import phone_scan
from s2rstore.maintenance.verify import verify

pytest.importorskip("vtkmodules")

_PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "phone-scan.md"
_SMALLER = {
    "--images 120": "--images 12",
    "--random 400": "--random 20",
    "--minutes 2": "--steps 3",
}


@pytest.mark.deep
def test_the_page_leads_from_a_scan_to_a_report(s2r, tmp_path, monkeypatch):
    text = _PAGE.read_text()
    for documented, smaller in _SMALLER.items():
        text = text.replace(documented, smaller)
    blocks = re.findall(r"^```\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    example, folder, *commands = (
        shlex.split(line) for block in blocks for line in block.splitlines()
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", example[2:])
    phone_scan.main()
    monkeypatch.chdir(folder[1])
    rows = [line.split("|")[1:5] for line in text.splitlines() if re.match(r"\| \d", line)]
    places = [[float(cell) for cell in row] for row in rows]
    np.testing.assert_allclose(places, np.loadtxt("places.csv", delimiter=",", skiprows=1))
    for program, *arguments in commands:
        assert program == "s2r"
        s2r(*arguments).checked()
    store = Path("flat.s2r")
    assert verify(store) == []
    assert "12" in Path("report.html").read_text()
    with s2rstore.open(store) as opened:
        run = opened.run_columns("vanilla")
        assert (np.count_nonzero(run.valid), np.count_nonzero(run.trained & run.paired)) == (12, 0)
        assert np.isfinite(run.sim.error).sum() == 32
        likeness = [
            np.corrcoef(opened.frame("sim", iid).rgb.ravel(), opened.frame("real", iid).rgb.ravel())
            for iid in range(12)
        ]
    assert np.median([matrix[0, 1] for matrix in likeness]) > 0.9
