"""The `--safe-csv` option: cells that a spreadsheet would execute as formulas become text."""

import csv
import io
from decimal import Decimal
from pathlib import Path

import pytest

from s2rtools.common.command_line.row_formats import csv_text
from tests.support import hostile
from tests.support.application import press, running

FORMULA = '=HYPERLINK("http://evil", "x")'


@pytest.fixture
def formula_store(store_copy: Path) -> Path:
    return hostile.edit(
        store_copy,
        ("UPDATE room SET room = ? || room", [FORMULA]),
        ("UPDATE instance SET room = ? || room", [FORMULA]),
        ("UPDATE dataset SET name = ?", [f"a,{FORMULA}"]),
    )


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "＝1"])
def test_formulas_are_prefixed(text):
    ((cell, *_),) = csv.reader(io.StringIO(csv_text((text,), [], safe=True), newline=""))
    assert cell == f"'{text}"


def test_numbers_are_unchanged():
    row = (-1, -0.5, Decimal("-2.5"), None, True, "plain", "a=b")
    written = csv_text(("a", "b", "c", "d", "e", "f", "g"), [row], safe=True)
    assert written.splitlines()[1] == '-1,-0.5,-2.5,"",True,"plain","a=b"'


def test_without_the_option_text_is_unchanged():
    assert csv_text(("=a",), [("=1",), (None,)]) == '=a\n=1\n""\n'


@pytest.mark.parametrize(
    "arguments",
    [
        ("query", "all", "--with-expression"),
        ("query", "all", "--columns", "iid,room"),
        ("sql", 'SELECT room, name AS "=1" FROM room, dataset'),
        ("show", "rooms"),
        ("runs",),
    ],
    ids=lambda arguments: arguments[0],
)
def test_commands_write_safe_csv(formula_store, s2r, arguments):
    command = [arguments[0], str(formula_store), *arguments[1:], "--format", "csv", "--safe-csv"]
    text = s2r(*command).printed
    cells = [cell for row in csv.reader(io.StringIO(text)) for cell in row]
    assert (FORMULA in text.replace('""', '"')) == (arguments[0] != "runs")
    for cell in cells:
        assert cell[:1] not in ("=", "@")
        assert cell[:1] not in ("+", "-") or _number(cell)


def _number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("safe", [False, True])
async def test_the_application_writes_safe_csv(formula_store, tmp_path, safe):
    async with running(formula_store, folder=tmp_path) as (app, pilot):
        app.export.safe_csv = safe
        await press(app, pilot, "c", "F", "enter")
    (written,) = tmp_path.glob("s2r-selection*.csv")
    assert ("'=HYPERLINK" in written.read_text()) == safe
