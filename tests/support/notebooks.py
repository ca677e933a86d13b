"""Run the code cells of a Jupyter notebook in this process, without Jupyter.

`python -m tests.support.notebooks FILE` runs a notebook in its folder and writes its outputs, as
`jupyter execute --inplace` does: printed text, and the value of the last expression of each cell
as text, HTML or PNG.
"""

import ast
import base64
import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

Output = dict[str, Any]


def code_cells(notebook: Path) -> list[dict[str, Any]]:
    return [cell for cell in _read(notebook)["cells"] if cell["cell_type"] == "code"]


def run(cells: list[dict[str, Any]]) -> list[list[Output]]:
    """Run code cells one after the other in one namespace, and return their outputs."""
    names: dict[str, Any] = {"__name__": "__main__"}
    return [
        _run_cell("".join(cell["source"]), names, number) for number, cell in enumerate(cells, 1)
    ]


def _run_cell(source: str, names: dict[str, Any], number: int) -> list[Output]:
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, place, value = io.StringIO(), f"cell {number}", None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, place, "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), place, "eval"), names)
    outputs: list[Output] = []
    if printed.getvalue():
        text = printed.getvalue().splitlines(keepends=True)
        outputs.append({"output_type": "stream", "name": "stdout", "text": text})
    if value is not None:
        data = {
            "output_type": "execute_result", "execution_count": number, "metadata": {},
            "data": _shown(value),
        }  # fmt: skip
        outputs.append(data)
    return outputs


def _shown(value: Any) -> dict[str, Any]:
    """The value by media type, as a notebook stores it."""
    shown: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
    if hasattr(value, "_repr_html_") and (text := value._repr_html_()):
        shown["text/html"] = text.splitlines(keepends=True)
    if hasattr(value, "_repr_png_"):
        shown["image/png"] = base64.b64encode(value._repr_png_()).decode()
    return shown


def execute(notebook: Path) -> None:
    """Run a notebook in its folder and write its outputs into it."""
    content = _read(notebook)
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    with contextlib.chdir(notebook.parent):
        for number, (cell, outputs) in enumerate(zip(cells, run(cells), strict=True), 1):
            cell["outputs"], cell["execution_count"] = outputs, number
    notebook.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _read(notebook: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(notebook.read_text(encoding="utf-8"))
    return content


if __name__ == "__main__":
    execute(Path(sys.argv[1]).resolve())
