"""Import folders of images without poses, one per domain; their images are not paired.

    index.csv      optional; columns file and condition, in recording order
    images/        optional; the folder that holds the images, else the folder itself
    masks/         not read

Every condition of `index.csv` is a trajectory. Without it every folder of images is one, its files
sorted by name. The name of a trajectory begins with that of its domain. All frames of a store have
one size: that of the most frequent size of the real images, scaled to the requested longer edge.
"""

from __future__ import annotations

import os
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.lazy_sequence import LazySequence, RowFile
from s2rstore.records import Side
from s2rtools.common.image_files import MAX_PIXELS, SUFFIXES
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.csv_rows import read_rows
from s2rtools.datasets.files.image_decoding import declared_size
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import RecordedFrame
from s2rtools.datasets.recordings.image_frame_source import ImageFrameSource
from s2rtools.datasets.recordings.recorded_files import ImageFile
from s2rtools.datasets.scan import FrameSource, Scan, ScanOptions
from s2rtools.datasets.writing import image_instances

INDEX = "index.csv"
IMAGES = "images"
MASKS = "masks"
COLUMNS = ("file", "condition")

Listing = dict[str, "array[int]"]
"""The numbers of the image files of each trajectory, in recording order."""


def scan(path: Path, options: ScanOptions) -> Scan:
    """List the images of `options.folders`; `path` stays empty.

    Raises RequestError for a folder without images, a malformed index and files outside the folder.
    """
    if path != Path() or not options.folders:
        raise RequestError("`s2r ingest images` reads --sim DIR and --real DIR, and takes no PATH")
    issues: list[InputIssue] = []
    outside: dict[str, int] = {}
    found: dict[str, tuple[Side, Sequence[ImageFile]]] = {}
    sizes: dict[Side, Counter[tuple[int, int]]] = {}
    for domain, folder in options.folders.items():
        reader = _FolderReader(folder, domain, options.allow_outside, outside, issues)
        sizes[domain] = reader.sizes
        for name, images in reader.trajectories().items():
            trajectory = f"{domain}_{name}" if name else domain
            if trajectory in found:
                reason = f"two folders make one trajectory, {trajectory}; rename one"
                raise RequestError(f"{folder}: {reason}")
            found[trajectory] = domain, images
    size = image_instances.frame_size(_commonest_size(sizes), max(options.frame))
    name = " + ".join(folder.resolve().name for folder in options.folders.values())
    kinds: dict[str, Side] = {domain: domain for domain in options.folders}
    result = image_instances.empty_scan(name, Path(), size, kinds)
    result.issues, result.outside_folders = issues, outside
    for trajectory in options.choose_trajectories(sorted(found), "the folders"):
        domain, images = found[trajectory]
        image_instances.add_images(result, trajectory, _sources(domain, images))
    return result


def _sources(domain: Side, images: Sequence[ImageFile]) -> Sequence[Mapping[str, FrameSource]]:
    return LazySequence(
        len(images), lambda row: {domain: ImageFrameSource(RecordedFrame(images[row]))}
    )


class _FolderReader:
    """Lists the images of one domain's folder; `issues` and `outside` are shared with others.

    `sizes` counts the usable images by (height, width).
    """

    def __init__(
        self,
        folder: Path,
        domain: Side,
        allow_outside: bool,
        outside: dict[str, int],
        issues: list[InputIssue],
    ) -> None:
        if not folder.is_dir():
            raise RequestError(f"{folder}: no such folder")
        self._folder, self._domain, self._issues = folder, domain, issues
        self._root = folder / IMAGES if (folder / IMAGES).is_dir() else folder
        self._containment = PathContainment(folder, allow_outside)
        self._containment.outside_folders = outside
        self._files, self._images = RowFile(), RowFile()
        self.sizes: Counter[tuple[int, int]] = Counter()

    def trajectories(self) -> dict[str, Sequence[ImageFile]]:
        """The usable images by condition, or by subfolder without an index; "" is the folder.

        Raises RequestError where there is none.
        """
        index, before = self._folder / INDEX, len(self._issues)
        has_index = index.exists() or index.is_symlink()
        listing = self._indexed(index) if has_index else self._by_folder()
        images = {name: self._usable(files) for name, files in listing.items()}
        if not any(images.values()):
            issue = next(iter(self._issues[before:]), None)
            first = f"; {issue}" if issue else ""
            raise RequestError(f"{self._folder}: no usable image ({', '.join(SUFFIXES)}){first}")
        return images

    def _by_folder(self) -> Listing:
        listing: Listing = {}
        folders: dict[str, Path] = {}
        for file in self._walk():
            name = "_".join(file.parent.relative_to(self._root).parts)
            listing.setdefault(name, array("i")).append(self._files.append(os.fsencode(file)))
            if folders.setdefault(name, file.parent) != file.parent:
                reason = f"it and {folders[name]} make one trajectory, {name}; rename one"
                raise RequestError(f"{file.parent}: {reason}")
        return listing

    def _walk(self) -> Iterator[Path]:
        """The image files, folder by folder; links to folders are not followed."""
        for folder, folders, files in os.walk(self._root):
            folders[:] = sorted(name for name in folders if name != MASKS)
            for name in sorted(files):
                if name.lower().endswith(SUFFIXES):
                    yield Path(folder, name)

    def _indexed(self, index: Path) -> Listing:
        """The rows of an index; incomplete and repeated rows and unlisted images are reported."""
        self._containment.check(index, str(index))
        inside = self._containment.for_folder(self._root)
        listing: Listing = {}
        listed: set[Path] = set()
        for number, row in read_rows(index, COLUMNS):
            where = f"{self._domain}/{INDEX}:{number}"
            if missing := [name for name in COLUMNS if name not in row]:
                raise RequestError(f"{index}: no column {missing[0]} (needs: {', '.join(COLUMNS)})")
            blank = [name for name in COLUMNS if not row[name]]
            name = row["file"]
            file = inside.find_file(name, f"{index}:{number}: file") or self._root / name
            if blank:
                self._issues.append(InputIssue("incomplete row", where, f"no {blank[0]}"))
            elif file in listed:
                self._issues.append(InputIssue("duplicate row", where, name))
            else:
                listed.add(file)
                number = self._files.append(os.fsencode(file))
                listing.setdefault(row["condition"], array("i")).append(number)
        if not listing:
            raise RequestError(f"{index}: no rows; the first line names {', '.join(COLUMNS)}")
        for file in self._walk():
            if file not in listed:
                self._issues.append(
                    InputIssue("unlisted image", self._name(file), f"not in {INDEX}")
                )
        return listing

    def _usable(self, files: array[int]) -> Sequence[ImageFile]:
        """The files whose header declares an image that can be decoded; reports the others."""
        usable = array("i")
        for number in files:
            (path,) = self._files[number]
            file = Path(os.fsdecode(path))
            self._containment.check(file, str(file))
            name = self._name(file)
            if not os.path.isfile(file):
                self._issues.append(InputIssue("missing image", name))
            elif (size := declared_size(file)) is None:
                detail = f"no image of at most {MAX_PIXELS:,} pixels"
                self._issues.append(InputIssue("unreadable image", name, detail))
            else:
                usable.append(self._images.append(path, os.fsencode(name), size))
                self.sizes[size] += 1

        def image(row: int) -> ImageFile:
            path, name, (height, width) = self._images[usable[row]]
            size = height, width
            return ImageFile(Path(os.fsdecode(path)), os.fsdecode(name), size, turns=True)

        return LazySequence(len(usable), image)

    def _name(self, file: Path) -> str:
        """The name of a file in reports and in the index: its domain, and its path inside."""
        inside = file.relative_to(self._folder) if file.is_relative_to(self._folder) else file
        return f"{self._domain}/{inside.as_posix()}"


def _commonest_size(sizes: dict[Side, Counter[tuple[int, int]]]) -> tuple[int, int]:
    """The most frequent (height, width) of the real images, or of all where there are none."""
    counted = sizes.get("real") or sum(sizes.values(), Counter())
    return counted.most_common(1)[0][0]
