"""A drawing with every mark, for tests of the renderers."""

from __future__ import annotations

import numpy as np

from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Dots, Line, Plot, Rule
from s2rtui.drawing.scale import Scale
from s2rtui.drawing.table import Cell, Column, Row, TableSpec

X = np.array([1.0, 2.0, 4.0, 8.0])
Y = np.array([0.0, 1.0, np.nan, 3.0])


def drawing() -> Drawing:
    marks = (
        Rule(2.0), Rule(1.0, "y", "faint"), Line(X, Y, "sim", "sim"),
        Line(X, Y[::-1], "real", "best", dashed=True), Dots(X, Y, "real", Y - 1, Y + 1),
    )  # fmt: skip
    plot = Plot(
        Scale(1, 8, ("position error of the instances (m)", "m"), log=True),
        Scale(0, 4, ("mean error (m)",)), marks,
    )  # fmt: skip
    rows = tuple(
        Row((Cell(f"row {k}"), Cell(f"{k}.25 m", "0.10 to 0.90"), Cell())) for k in range(4)
    )
    table = TableSpec((Column(""), Column("sim", "sim"), Column("real", "real")), rows)
    return Drawing((plot,), table, ("n 100", "no interval: n 7, a median needs 25"))
