"""Contact sheets: source, translated and target images side by side, drawn at random."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rtools.translation.image_set import Rgb
from s2rtools.translator_evaluation import image_structure as structure
from s2rtools.translator_evaluation.judged_frames import JudgedFrames

ROWS = 6
MIN_WIDTH = 256
"""Pixels of the width of an image on the sheet, at least."""
_MARGIN, _LINE = 6, 26
_INK, _PAPER = (20, 20, 20), 255


def frames_sheet(frames: JudgedFrames, titles: tuple[str, str, str], seed: int) -> Rgb:
    """Sheet (H, W, 3) of some judged frames, beside the target's image of the same pose.

    Where the target shows other places, beside its image of the nearest layout. `titles` are those
    of the source, the translation and the target.
    """
    count = min(ROWS, len(frames.source))
    drawn = np.sort(np.random.default_rng(seed).choice(len(frames.source), count, replace=False))
    source = frames.source[drawn]
    target = frames.target[drawn] if frames.paired else _nearest(source, frames.target)
    columns = (
        (titles[0], source),
        (titles[1], frames.translated[drawn]),
        (f"{titles[2]}, {'same pose' if frames.paired else 'nearest layout'}", target),
    )
    return draw_sheet(columns, [frames.labels[row] for row in drawn], seed)


def _nearest(images: Rgb, candidates: Rgb) -> Rgb:
    """For each image, the candidate whose edges lie most alike."""
    known = np.stack([structure.layout_descriptor(image) for image in candidates])
    rows = [int((known @ structure.layout_descriptor(image)).argmax()) for image in images]
    return candidates[rows]


def draw_sheet(columns: Sequence[tuple[str, Rgb]], labels: Sequence[str], seed: int) -> Rgb:
    """Columns of images (N, h, w, 3) of one size, with a title each and a label for each row."""
    height, width = columns[0][1].shape[1:3]
    factor = max(1, -(-MIN_WIDTH // width))
    height, width = height * factor, width * factor
    count = len(labels)
    full = (
        _LINE + count * (height + _LINE + _MARGIN) + _LINE,
        _MARGIN + len(columns) * (width + _MARGIN),
    )
    sheet = np.full((*full, 3), _PAPER, dtype=np.uint8)
    for column, (title, images) in enumerate(columns):
        left = _MARGIN + column * (width + _MARGIN)
        _write(sheet, title, left, _LINE, width)
        for row, image in enumerate(images):
            top = _LINE + row * (height + _LINE + _MARGIN) + _MARGIN
            enlarged = cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST)
            sheet[top : top + height, left : left + width] = enlarged
            if column == 0:
                _write(sheet, labels[row], left, top + height + _LINE, width)
    _write(sheet, f"drawn at random with seed {seed}", _MARGIN, full[0], full[1])
    return sheet


def _write(sheet: Rgb, text: str, left: int, bottom: int, width: int) -> None:
    """Write a line above row `bottom`; characters that the font lacks become question marks."""
    text = text.encode("ascii", "replace").decode()
    scale = 0.5
    while text and cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)[0][0] > width:
        text = text[:-1]
    cv2.putText(
        sheet, text, (left, bottom - 8), cv2.FONT_HERSHEY_SIMPLEX, scale, _INK, 1, cv2.LINE_AA
    )


def write_png(path: Path, image: Rgb) -> None:
    """Write an image as PNG. Raises RequestError if it cannot be written."""
    encoded, content = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    if not encoded:
        raise RequestError(f"{path}: the image cannot be encoded as PNG")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_writes.write_file(path.resolve(), content.tobytes())
    except OSError as error:
        raise RequestError(f"{path}: cannot be written ({error.strerror})") from error
