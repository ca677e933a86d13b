"""Read label images: a folder of PNG files with a list of classes, or a COCO file."""

from __future__ import annotations

import io
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import cv2
import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from PIL import Image

from s2rstore.errors import RequestError, counted
from s2rstore.files.documents import read_json
from s2rstore.files.input_files import read_bytes, read_text
from s2rstore.reader import Store
from s2rstore.records import MAX_LABEL
from s2rstore.security.printable_text import printable
from s2rtools.common.image_files import declared_size
from s2rtools.common.tables.csv_rows import missing_column, read_rows
from s2rtools.common.typed_documents import convert

_MAX_BYTES = 1 << 26
_MAX_NAME = 100
_MOST_SIDE = 16_384
"""Pixels of a side of a label image in a COCO file."""
_NAME_COLUMNS = ("name", "raw_category")
"""Columns with the class; the second is that of ScanNet's table of labels."""

LabelImage = NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class LabelSource:
    """Label images of some instances of a domain.

    `names` are the classes by the values of pixels. `read` gives the image (h, w) of one of `iids`,
    of any size, and raises RequestError where it cannot be read.
    """

    names: Mapping[int, str]
    iids: frozenset[int]
    read: Callable[[int], LabelImage]


def read_source(store: Store, domain: str, path: Path, classes: Path | None) -> LabelSource:
    """The label images in a folder of PNG files, or in a COCO file, of the frames of a domain.

    Raises RequestError where a file belongs to no frame, or the classes are missing or invalid.
    """
    if path.suffix.lower() == ".json":
        if classes is not None:
            raise RequestError(f"--classes {classes}: {path} has its own categories; leave it out")
        return _coco(store, domain, path)
    if not path.is_dir():
        raise RequestError(f"{path}: no such folder, and no COCO file (.json)")
    if classes is None:
        raise RequestError(f"--classes: name a CSV file with the columns id,name for {path}")
    names = _read_classes(classes)
    files = sorted(each for each in path.rglob("*") if each.suffix.lower() == ".png")
    if not files:
        raise RequestError(f"{path}: holds no PNG file")
    by_name = {each.relative_to(path).as_posix(): each for each in files}
    by_iid = {iid: by_name[name] for name, iid in _matched(store, domain, by_name, path).items()}

    def read(iid: int) -> LabelImage:
        return _read_png(by_iid[iid], names, classes)

    return LabelSource(names, frozenset(by_iid), read)


def _number(text: str) -> int | None:
    """The number that a text of at most 18 digits is; None for other texts."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 19 else None


def _read_classes(path: Path) -> dict[int, str]:
    """Classes by value of a CSV file with columns id and name, or of ScanNet's table (.tsv)."""
    names: dict[int, str] = {}
    for number, row in _class_rows(path):
        column = next((each for each in _NAME_COLUMNS if each in row), "name")
        for needed in ("id", column):
            if needed not in row:
                raise missing_column(path, needed, row, "id,name")
        label = _number(row["id"])
        if label is None or label > MAX_LABEL:
            raise RequestError(f"{path}:{number}: id {row['id'][:20]!r}: 0 .. {MAX_LABEL}")
        if label and names.setdefault(label, row[column]) != row[column]:
            raise RequestError(f"{path}:{number}: id {label} has two names")
    return _checked_names(names, path)


def _class_rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """The rows of a table of classes by column, with the number of their line."""
    if path.suffix.lower() != ".tsv":
        yield from read_rows(path, None)
        return
    head, *lines = read_text(path, _MAX_BYTES).splitlines() or [""]
    for number, line in enumerate(lines, 2):
        yield number, dict(zip(head.split("\t"), line.split("\t"), strict=False))


def _checked_names(names: dict[int, str], path: Path) -> dict[int, str]:
    for label, name in names.items():
        if not name.strip() or len(name) > _MAX_NAME or printable(name) != name:
            raise RequestError(
                f"{path}: the name of label {label} is not 1 to {_MAX_NAME} printable characters"
            )
    if not names:
        raise RequestError(f"{path}: names no class")
    return names


def _matched(store: Store, domain: str, names: Mapping[str, object], where: Path) -> dict[str, int]:
    """The instance of each label file, by the name of its source image, else by its number.

    The name is the path in the ingested folder, or the file name where that is unique; suffixes do
    not count. Numbers are those of instances only where no source image is called by a number.
    Raises RequestError for files that belong to no frame.
    """
    query = "SELECT iid, rgb_path FROM frame WHERE domain = ?"
    frames = [(int(iid), path) for iid, path in store.execute(query, [domain])]
    stems = Counter(PurePosixPath(path).stem for _, path in frames if path)
    known: dict[str, int] = {}
    for iid, path in frames:
        if path:
            source = PurePosixPath(path).with_suffix("")
            known[source.as_posix()] = iid
            if stems[source.stem] == 1:
                known.setdefault(source.stem, iid)

    def of_source(name: str) -> int | None:
        bare = PurePosixPath(name).with_suffix("")
        return known.get(bare.as_posix(), known.get(bare.name))

    numbers = {iid for iid, _ in frames}

    def of_number(name: str) -> int | None:
        stem = PurePosixPath(name).stem
        number = _number(stem)
        return number if number in numbers else None

    is_numbered = any(_number(stem) is not None for stem in stems)
    for find in (of_source,) if is_numbered else (of_source, of_number):
        found = {name: find(name) for name in names}
        matched = {name: iid for name, iid in found.items() if iid is not None}
        if len(matched) == len(found):
            if twice := [iid for iid, n in Counter(matched.values()).items() if n > 1]:
                raise RequestError(f"{where}: instance {twice[0]} has two label images")
            return matched
    name = next(name for name in names if of_source(name) is None)
    raise RequestError(
        f"{where}: {name} belongs to no frame of {domain}; name label images by the paths of the "
        "ingested images or, where these are not numbered, by the numbers of instances (12.png)"
    )


def _read_png(path: Path, names: Mapping[int, str], classes: Path) -> LabelImage:
    content = read_bytes(path, _MAX_BYTES)
    try:
        declared_size(content)
        values = np.asarray(Image.open(io.BytesIO(content)))
    except (ValueError, OSError, SyntaxError) as error:
        raise RequestError(f"{path}: cannot be read as an image ({error})") from error
    if values.ndim != 2 or values.dtype.kind not in "ui" or int(values.max(initial=0)) > MAX_LABEL:
        raise RequestError(f"{path}: not an image of one channel of 8 or 16 bits")
    if unknown := sorted(set(np.unique(values).tolist()) - {0} - names.keys()):
        raise RequestError(f"{path}: {counted(len(unknown), 'value')} not in {classes}, "
                           f"such as {unknown[0]}")  # fmt: skip
    return values.astype(np.uint16)


class _Category(msgspec.Struct):
    id: Annotated[int, Meta(ge=1, le=MAX_LABEL)]
    name: str


class _CocoImage(msgspec.Struct):
    id: int | str
    file_name: str
    height: Annotated[int, Meta(ge=1, le=_MOST_SIDE)]
    width: Annotated[int, Meta(ge=1, le=_MOST_SIDE)]


class _Annotation(msgspec.Struct):
    image_id: int | str
    category_id: int
    segmentation: Any


class _Coco(msgspec.Struct):
    """The parts of a COCO file that are read."""

    categories: Annotated[list[_Category], Meta(min_length=1)]
    images: Annotated[list[_CocoImage], Meta(min_length=1)]
    annotations: list[_Annotation]


def _coco(store: Store, domain: str, path: Path) -> LabelSource:
    """The segmentations of a COCO file; of overlapping ones, the smaller covers the larger."""
    content = convert(read_json(path, _MAX_BYTES), _Coco, str(path), check=False)
    names = {each.id: each.name for each in content.categories}
    images = {each.id: each for each in content.images}
    for what, listed in (
        ("id of a category", [each.id for each in content.categories]),
        ("id of an image", [each.id for each in content.images]),
        ("file_name", [each.file_name for each in content.images]),
    ):
        if repeated := [each for each, count in Counter(listed).items() if count > 1]:
            raise RequestError(f"{path}: {what} {repeated[0]!r} stands twice")
    iids = _matched(store, domain, {each.file_name: each for each in content.images}, path)
    masks: defaultdict[int | str, list[_Annotation]] = defaultdict(list)
    for annotation in content.annotations:
        if annotation.category_id not in names:
            what = f"category {annotation.category_id}"
        elif annotation.image_id not in images:
            what = f"image {annotation.image_id!r}"
        else:
            masks[annotation.image_id].append(annotation)
            continue
        raise RequestError(f"{path}: an annotation is of {what}, which is not listed")
    keys = {iids[image.file_name]: image.id for image in content.images}

    def read(iid: int) -> LabelImage:
        image = images[keys[iid]]
        labels = np.zeros((image.height, image.width), dtype=np.uint16)
        try:
            made = [(_coco_mask(each.segmentation, labels.shape), each.category_id)
                    for each in masks[image.id]]  # fmt: skip
        except (KeyError, TypeError, ValueError, IndexError, OverflowError, cv2.error) as error:
            problem = f"{path}: a segmentation of {image.file_name} is invalid"
            raise RequestError(problem) from error
        for mask, label in sorted(made, key=lambda each: -int(each[0].sum())):
            labels[mask] = label
        return labels

    return LabelSource(_checked_names(names, path), frozenset(keys), read)


def _coco_mask(segmentation: Any, size: tuple[int, ...]) -> NDArray[np.bool_]:
    """The mask (h, w) of polygons, or of run lengths, which may be compressed."""
    if isinstance(segmentation, list):
        mask = np.zeros(size, dtype=np.uint8)
        for polygon in segmentation:  # one by one: of several, overlaps would stay empty
            corners = np.reshape(np.asarray(polygon, dtype=np.float64), (-1, 2))
            if not (np.abs(corners) <= _MOST_SIDE).all():
                raise ValueError("a corner far outside of the image")
            cv2.fillPoly(mask, [np.rint(corners).astype(np.int32)], 1)
        return mask > 0
    counts = segmentation["counts"]
    lengths = _decompressed(counts) if isinstance(counts, str) else counts
    if min(lengths) < 0 or sum(lengths) != size[0] * size[1]:
        raise ValueError("run lengths of another size")
    values = np.arange(len(lengths)) % 2
    return np.repeat(values, lengths).reshape(size[::-1]).T > 0


def _decompressed(text: str) -> list[int]:
    """The run lengths of a compressed COCO mask.

    Each is written as digits of 5 bits from the lowest on, of which the last carries the sign; from
    the fourth on as the difference from the last but one.
    """
    lengths: list[int] = []
    value = shift = 0
    for character in text.encode():
        digit = character - 48
        value |= (digit & 31) << shift
        shift += 5
        if digit & 32:
            continue
        if digit & 16:
            value -= 1 << shift
        lengths.append(value + lengths[-2] if len(lengths) > 2 else value)
        value = shift = 0
    return lengths
