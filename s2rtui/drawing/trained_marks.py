"""Marks of trained instances in cells.

A cell with a trained instance keeps what it says (one or several instances, their number, a digit
of a scale): its glyph is replaced by a form of the same glyph that is the mark.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas import DIGITS, Canvas, RenderOptions
from s2rtui.drawing.legend import LegendPart, text_part

_RINGED, _LETTERS = "⓪①②③④⑤⑥⑦⑧⑨", "abcdefghij"
SEVERAL = "▣"
"""Several instances, of which the model was trained on some."""
MANY = {False: "⊕", True: "T"}
"""`+`, a number above 9, of which some are trained instances; by whether it is ASCII."""


Cells = NDArray[np.bool_] | tuple[NDArray[np.intp], NDArray[np.intp]]
"""Cells of a canvas: a mask (h, w), or their rows and columns."""


@dataclass(frozen=True, slots=True)
class TrainedForms:
    """The form of each glyph that marks a trained instance; other glyphs get the plain mark.

    `legend`: the forms as the legend shows them.
    """

    forms: Mapping[str, str]
    legend: str


def digit_forms(options: RenderOptions) -> TrainedForms:
    """Forms of digits that stand for values: ringed, or letters in ASCII."""
    if options.ascii:
        return TrainedForms(_forms(DIGITS, _LETTERS), "a-j (for 0-9)")
    return TrainedForms(_forms(DIGITS, _RINGED), f"{_RINGED[0]}-{_RINGED[9]}")


def number_forms(options: RenderOptions, single: str) -> TrainedForms:
    """Forms of numbers of instances: those of one instance, `single`, of 2 to 9 and of more."""
    mark, many = options.glyphs.trained, MANY[options.ascii]
    digits = _LETTERS if options.ascii else _RINGED
    forms = {**_forms(DIGITS, digits), "+": many, **dict.fromkeys(single, mark)}
    shown = f"{mark} {digits[2]}-{digits[9]} {many}"
    return TrainedForms(forms, f"{shown} (for 1, 2-9, +)" if options.ascii else shown)


def glyph_forms(glyphs: str, forms: str, shown: str = "") -> TrainedForms:
    """The forms of some glyphs, in the same order; the legend shows `shown`, by default all."""
    return TrainedForms(_forms(glyphs, forms), shown or forms)


def _forms(glyphs: str, forms: str) -> dict[str, str]:
    return dict(zip(glyphs, forms, strict=True))


def mark_trained(canvas: Canvas, cells: Cells, marks: TrainedForms) -> None:
    """Give the glyphs of cells the forms that mark trained instances."""
    drawn = canvas.char[cells]
    marked = np.full(drawn.shape, canvas.glyphs.trained, dtype="<U1")
    for glyph, form in marks.forms.items():
        marked[drawn == glyph] = form
    canvas.char[cells] = marked


def number_glyphs(counts: NDArray[np.integer], single: str) -> NDArray[np.str_]:
    """The glyphs of numbers of instances (n,): `single` for 1, the number up to 9, then `+`."""
    names = np.array([" ", single, *DIGITS[2:], "+"])
    return np.asarray(names[np.minimum(counts, len(DIGITS))])


def trained_legend(options: RenderOptions, marks: TrainedForms | None = None) -> LegendPart:
    """The part that explains the forms of trained instances, by default the plain mark."""
    theme = options.theme
    shown = options.glyphs.trained if marks is None else marks.legend
    return text_part(((f"{shown} ", theme.text), ("trained on", theme.muted)))
