"""The files of a night: written where they differ, so that what is told already stays untouched."""

from __future__ import annotations

import os
import re
import shutil
from contextlib import suppress
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.gap_history import reader
from s2rstore.gap_history.reader import History, Night
from s2rtools.common.result_files import write_all
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.history_plot import picture
from s2rtools.nightly.html_report import page
from s2rtools.nightly.junit import junit
from s2rtools.nightly.markdown import markdown
from s2rtools.nightly.metrics import metrics
from s2rtools.nightly.night_status import content

LATEST = "latest"


def publish(config: NightlyConfig, found: History, night: Night) -> list[Path]:
    """Write this night's reports, and what tells of the newest night; gives what was written.

    All files or none, and those that differ only.
    """
    folder = config.reports / str(night.night)
    newest = found.counting(config.name)[-1]
    files = _files(config, found, night, folder)
    if config.metrics is not None:
        _folder(config.metrics.parent)
        files[config.metrics] = metrics(newest)
    changed = {path: data for path, data in files.items() if not _is_so(path, data)}
    write_all(changed)
    written = list(changed)
    if _point(config.reports / LATEST, str(newest.night)):
        written.append(config.reports / LATEST)
    return written


def check_own(config: NightlyConfig) -> None:
    """Raises RequestError where the reports or the metrics there are another gate's."""
    suites = config.reports / LATEST / "junit.xml", r'<testsuite name="([^"]*)"'
    places = {"reports": (config.reports, *suites)}
    if config.metrics is not None:
        places["metrics"] = (config.metrics, config.metrics, r'[{,]nightly="([^"]*)"')
    for name, (place, file, pattern) in places.items():
        try:
            found = re.search(pattern, file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if found and found[1] != config.name:
            raise RequestError(
                f"{config.source}: output.{name}: {place} is that of the gate {found[1]!r}; "
                f"give {config.name!r} a place of its own"
            )


def _files(config: NightlyConfig, found: History, night: Night, folder: Path) -> dict[Path, bytes]:
    told = content(found, night)
    drawn = picture(told)
    report = reader.report_text(config.history, night.measured)
    _folder(folder)
    return {
        folder / "history.png": drawn,
        folder / "report.json": f"{report}\n".encode(),
        folder / "report.md": markdown(told).encode(),
        folder / "report.html": page(told, drawn).encode(),
        folder / "junit.xml": junit(told),
    }


def _folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RequestError(f"{path}: {error.strerror or error}") from error


def _is_so(path: Path, data: bytes) -> bool:
    with suppress(FileNotFoundError):
        return path.read_bytes() == data
    return False


def _point(link: Path, target: str) -> bool:
    """Make `latest` the newest night: a link, or a copy where the file system knows no links."""
    if link.is_symlink() and os.readlink(link) == target:
        return False
    beside = link.with_name(f".{link.name}.{os.getpid()}")
    try:
        try:
            beside.symlink_to(target)
        except OSError:
            return _copied(link, target, beside)
        beside.replace(link)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        raise RequestError(f"{link}: {error.strerror or error}") from error
    return True


def _copied(link: Path, target: str, beside: Path) -> bool:
    names = sorted(path.name for path in (link.parent / target).iterdir())
    same = link.is_dir() and all(
        (link / name).is_file() and (link / name).read_bytes() == path.read_bytes()
        for name in names for path in [link.parent / target / name]
    )  # fmt: skip
    if same:
        return False
    shutil.copytree(link.parent / target, beside)
    shutil.rmtree(link, ignore_errors=True)
    beside.replace(link)
    return True
