"""Images of one domain for fitting and judging translators."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays.row_array import evenly_spaced
from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_bytes
from s2rstore.reader import Store
from s2rtools.common.image_files import SUFFIXES, declared_size

Rgb = NDArray[np.uint8]

LONG_EDGE = 160
"""Pixels of the longer edge of images for fitting."""
EDGE_MULTIPLE = 8
"""Both edges are multiples of this number, so that networks can halve them three times."""
MAX_IMAGE_BYTES = 64 << 20
MAX_FIT_IMAGES = 2000
"""Most images of a domain that a fit reads; more are left out at even distances (115 MB at
120 x 160 pixels)."""
_BLOCK = 64


@dataclass(frozen=True, slots=True, eq=False)
class ImageSet:
    """Images (N, h, w, 3) uint8 RGB in recording order.

    `groups` (N,) are the codes of recordings: neighbours inside one look alike. `names` are file
    names or `DOMAIN/IID`. `iids` (N,) are instances of a store, None for files.
    """

    name: str
    images: Rgb
    groups: NDArray[np.int32]
    names: tuple[str, ...]
    iids: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.images)

    @property
    def size(self) -> tuple[int, int]:
        return int(self.images.shape[1]), int(self.images.shape[2])

    def rows(self, rows: NDArray[np.intp] | slice) -> ImageSet:
        """The images of some rows."""
        index = np.arange(len(self))[rows]
        iids = None if self.iids is None else self.iids[index]
        names = tuple(self.names[row] for row in index)
        return ImageSet(self.name, self.images[index], self.groups[index], names, iids)

    def from_row(self, start: int) -> ImageSet:
        """The images without the rows above `start`."""
        return replace(self, images=self.images[:, start:]) if start else self


def fit_size(height: int, width: int, long_edge: int = LONG_EDGE) -> tuple[int, int]:
    """Size of images for fitting: the same aspect within rounding to `EDGE_MULTIPLE`, never larger
    than the source (rounded up)."""
    scale = min(1.0, long_edge / max(height, width))

    def rounded(edge: int) -> int:
        return max(EDGE_MULTIPLE, EDGE_MULTIPLE * round(edge * scale / EDGE_MULTIPLE))

    return rounded(height), rounded(width)


def resize(rgb: Rgb, size: tuple[int, int]) -> Rgb:
    """Resize images (B, H, W, 3) to (B, *size, 3), by area where they become smaller."""
    height, width = rgb.shape[1:3]
    if (height, width) == size:
        return rgb
    smaller = size[0] <= height and size[1] <= width
    how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    return np.stack([cv2.resize(image, size[::-1], interpolation=how) for image in rgb])


def from_store(
    store: Store, domain: str, iids: NDArray[np.int64], size: tuple[int, int] | None = None
) -> ImageSet:
    """Images of some instances in a domain, in iid order.

    Instances that the domain does not image are left out; this occurs only in data sets without
    poses. Raises RequestError for an unknown domain, and where no instance is left.
    """
    if domain not in store.domains:
        raise RequestError(f"domain {domain!r}: not in {store.path}: {', '.join(store.domains)}")
    dataset = store.dataset
    size = size or fit_size(dataset.frame_height, dataset.frame_width)
    iids = np.sort(iids)
    iids = iids[store.imaged(domain)[iids]]
    if not iids.size:
        raise RequestError(f"{store.path}: domain {domain} images none of the chosen instances")
    groups = store.instances.trajectory[iids].astype(np.int32)
    images = np.empty((len(iids), *size, 3), dtype=np.uint8)
    done = 0
    starts = (np.diff(iids // _BLOCK) != 0) | (np.diff(groups) != 0)
    for chosen in np.split(iids, np.flatnonzero(starts) + 1):
        first, last = int(chosen[0]), int(chosen[-1])
        rgb = store.frames(domain, first, last + 1, ("rgb",))["rgb"][chosen - first]
        images[done : done + len(chosen)] = resize(rgb, size)
        done += len(chosen)
    return ImageSet(domain, images, groups, tuple(f"{domain}/{iid}" for iid in iids), iids)


def image_files(folder: Path) -> list[Path]:
    """Image files of a folder and its subfolders, sorted by path. Raises RequestError if none."""
    if not folder.is_dir():
        raise RequestError(f"{folder}: no such folder")
    files = sorted(
        path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file()
    )
    if not files:
        raise RequestError(f"{folder}: no image files ({', '.join(SUFFIXES)})")
    return files


def read_image(path: Path) -> Rgb:
    """An 8-bit RGB image (H, W, 3) of a file, turned as the file states.

    Raises RequestError if it cannot be decoded or is too large.
    """
    content = read_bytes(path, MAX_IMAGE_BYTES)
    try:
        declared_size(content)
        decoded = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    except (ValueError, cv2.error, MemoryError) as error:
        reason = str(error) if isinstance(error, ValueError) else "its content is damaged"
        raise RequestError(f"{path}: cannot be decoded as an image ({reason})") from error
    if decoded is None:
        raise RequestError(f"{path}: cannot be decoded as an image")
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB))


def from_folder(
    folder: Path,
    size: tuple[int, int] | None = None,
    long_edge: int = LONG_EDGE,
    max_images: int = MAX_FIT_IMAGES,
) -> ImageSet:
    """Images of a folder, at most `max_images` evenly spaced; each subfolder counts as one
    recording.

    `size` defaults to that of the first image, reduced to `long_edge`.
    """
    files = image_files(folder)
    files = [files[row] for row in evenly_spaced(np.arange(len(files)), max_images)]
    first = read_image(files[0])
    size = size or fit_size(first.shape[0], first.shape[1], long_edge)
    images = np.empty((len(files), *size, 3), dtype=np.uint8)
    for row, file in enumerate(files):
        images[row] = resize(read_image(file)[None], size)[0]
    folders = [str(file.parent.relative_to(folder)) for file in files]
    codes = np.unique(folders, return_inverse=True)[1].astype(np.int32)
    names = tuple(str(file.relative_to(folder)) for file in files)
    return ImageSet(folder.name, images, codes, names)
