"""The notebook in `examples` runs on a small store, and holds the outputs of an earlier run."""

from __future__ import annotations

import base64
from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image

from tests.support import notebooks

NOTEBOOK = Path(__file__).parents[2] / "examples" / "store.ipynb"


@pytest.mark.usefixtures("declared_entry_points")
def test_all_cells_run_on_a_small_store(tiny_store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("S2R_STORE", str(tiny_store))
    outputs = [output for cell in notebooks.run(notebooks.code_cells(NOTEBOOK)) for output in cell]
    shown = [output["data"] for output in outputs if output["output_type"] == "execute_result"]
    assert any(line.startswith("  data set: ") for line in shown[0]["text/plain"])
    pictures = [data["image/png"] for data in shown if "image/png" in data]
    assert len(pictures) == 2
    for picture in pictures:
        assert Image.open(BytesIO(base64.b64decode(picture))).width == round(120 / 25.4 * 110)


def test_the_notebook_holds_outputs_and_no_machine_path() -> None:
    cells = notebooks.code_cells(NOTEBOOK)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert sum("image/png" in output.get("data", {}) for c in cells for output in c["outputs"]) == 2
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert not any(folder in text for folder in ("/home/", "/tmp/", "/root/", "/work/", "/Users/"))
    assert NOTEBOOK.stat().st_size < 400_000
