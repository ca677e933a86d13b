"""A folder of images that another program generated, judged as a translator of a store is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Direction, Side
from s2rtools.translation.image_set import Rgb, image_files, read_image, resize
from s2rtools.translator_evaluation.fit_into_store import named_domains
from s2rtools.translator_evaluation.judged_frames import MIN_IMAGES, Iids, Translation


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GeneratedImages(Translation):
    """Images of a folder, each made from the source's image of an instance.

    `files` holds the file of each iid; whether what generated them was trained on these images is
    not known.
    """

    files: dict[int, Path]

    @property
    def method(self) -> str:
        return "folder"

    def translated(
        self, iids: Iids, rgb: Rgb, depth: NDArray[Any], valid: NDArray[np.bool_]
    ) -> tuple[Rgb, NDArray[Any]]:
        """The images at the size of the source's, and the depth of the source."""
        size = rgb.shape[1], rgb.shape[2]
        images = [resize(read_image(self.files[iid])[None], size) for iid in iids.tolist()]
        return np.concatenate(images), depth


def generated_images(
    store: Store, folder: Path, like: Side, domains: tuple[str, str] | None = None
) -> GeneratedImages:
    """The images of a folder and its subfolders that shall look like side `like` of a store.

    Their names are the iids of the instances, such as `17.png` or `000017.jpg`. `domains` are the
    names of the sim and the real domain. Raises RequestError for other names, for two images of an
    instance, for instances of which a domain has no image, and for fewer than `MIN_IMAGES` images.
    """
    direction: Direction = "sim2real" if like == "real" else "real2sim"
    source, target = named_domains(store, direction, domains)
    imaged = store.imaged(*((source, target) if store.has_poses else (source,)))
    files: dict[int, Path] = {}
    for path in image_files(folder):
        if not (path.stem.isascii() and path.stem.isdecimal()):
            raise RequestError(f"{path}: name it by the iid of its instance, such as 17.png")
        iid = int(path.stem)
        if iid >= len(imaged) or not imaged[iid]:
            needed = f"{source} and {target}" if store.has_poses else source
            raise RequestError(f"{path}: instance {iid} has no images of {needed} in {store.path}")
        if iid in files:
            raise RequestError(f"{path}: instance {iid} has another image, {files[iid]}")
        files[iid] = path
    if len(files) < MIN_IMAGES:
        raise RequestError(f"{folder}: {len(files)} images; judging needs {MIN_IMAGES}")
    iids = np.array(sorted(files), dtype=np.int64)
    name = folder.resolve().name
    return GeneratedImages(name, direction, source, target, iids[:0], iids, files=files)
