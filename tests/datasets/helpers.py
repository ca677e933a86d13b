"""Run an ingest or an append with the options that the tests use."""

import hashlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import s2rstore
from s2rstore.files import layout
from s2rtools.datasets.appending.append import append
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.recording import Recording
from s2rtools.datasets.scan import Scan, ScanOptions
from s2rtools.datasets.writing.build import build

SIZE = (32, 32)


class Killed(BaseException):
    """Stands for the end of the process at this point."""


def kill_after(function: Callable[..., object], calls: int) -> Callable[..., object]:
    """The function, whose call number `calls`, from 0, ends the process instead."""
    done = 0

    def counted(*arguments: object, **options: object) -> object:
        nonlocal done
        if done == calls:
            raise Killed
        done += 1
        return function(*arguments, **options)

    return counted


def kill(*arguments: object, **options: object) -> None:
    raise Killed


def ingest(importer: str, path: Path, store: Path, strict: bool = False, **options) -> Scan:
    scan = IMPORTERS[importer](path, ScanOptions(frame=SIZE, **options))
    build(scan, store, "s2r ingest", strict, lambda steps: None)
    return scan


def kinds(found: Scan | Recording) -> dict[str, int]:
    """How many issues of each kind were found."""
    return dict(Counter(issue.kind for issue in found.issues))


def scan_of(name: str, path: Path, **options) -> Scan:
    return IMPORTERS[name](path, ScanOptions(**{"frame": SIZE, **options}))


def add(
    scan: Scan, store: Path, strict: bool = False, lines: list[str] | None = None
) -> dict[str, int]:
    said = [] if lines is None else lines
    return append(scan, store, "s2r ingest", strict, lambda steps: None, said.append).instances


def rows_by_trajectory(store: Path) -> dict[str, object]:
    """All rows of instances, frames and trajectories without iids, and the frames themselves."""
    with s2rstore.open(store) as opened:
        found: dict[str, object] = {
            "trajectory": opened.execute("FROM trajectory ORDER BY trajectory"),
            "room": opened.execute("FROM room ORDER BY position"),
            "domain": opened.execute("SELECT * EXCLUDE (hash) FROM domain ORDER BY domain"),
            "instance": opened.execute(
                "SELECT * EXCLUDE (iid) FROM instance ORDER BY trajectory, seq"
            ),
            "frame": opened.execute(
                "SELECT trajectory, seq, frame.* EXCLUDE (iid) FROM frame JOIN instance USING "
                "(iid) ORDER BY trajectory, seq, domain"
            ),
        }
        for domain, parts in opened.imaged_parts.items():
            for trajectory in sorted({part.trajectory for part in parts}):
                digest = hashlib.sha256()
                for iid in opened.iids_of(trajectory):
                    one = int(iid), int(iid) + 1
                    ((_, source),) = opened.source_frames(domain, *one)
                    for image in (*opened.frames(domain, *one).values(), *source.values()):
                        digest.update(image.tobytes())
                found[f"{domain} {trajectory}"] = digest.hexdigest()
    return found


def files(store: Path) -> dict[str, str]:
    """SHA-256 of the files that no generation may change."""
    return {
        path.relative_to(store).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in store.rglob("*")
        if path.is_file()
        and path.relative_to(store).parts[0] in (layout.FRAMES, layout.INDEX, layout.ASSETS)
    }
