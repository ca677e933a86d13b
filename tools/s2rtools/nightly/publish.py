"""Publish the files of a night; unchanged files are not written."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from contextlib import suppress
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.gap_history import reader
from s2rstore.gap_history.reader import History, Night
from s2rtools.common.result_files import write_all
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.history_plot import history_plot
from s2rtools.nightly.report_files import html, junit, markdown, metrics
from s2rtools.nightly.report_model import night_report

LATEST = "latest"
_TEMPORARY = re.compile(r"\.[0-9a-f]{16}")
"""Suffix of the temporary names of `_set_latest`."""


def publish(config: NightlyConfig, history: History, night: Night) -> list[Path]:
    """Write the reports of a night, and metrics and link of the newest; return the written paths.

    Writes all changed files or none.
    """
    folder = config.reports / str(night.night)
    newest = history.of_configuration(config.name)[-1]
    report = night_report(history, night)
    plot = history_plot(report)
    document = reader.report_text(config.history, night.measured)
    _make_folder(folder)
    files = {
        folder / "history.png": plot,
        folder / "report.json": f"{document}\n".encode(),
        folder / "report.md": markdown(report).encode(),
        folder / "report.html": html(report, plot).encode(),
        folder / "junit.xml": junit(report),
    }
    if config.metrics is not None:
        _make_folder(config.metrics.parent)
        files[config.metrics] = metrics(newest)
    changed = {path: data for path, data in files.items() if not _is_current(path, data)}
    write_all(changed)
    written = list(changed)
    if _set_latest(config.reports / LATEST, str(newest.night)):
        written.append(config.reports / LATEST)
    return written


def check_ownership(config: NightlyConfig) -> None:
    """Raises RequestError where reports or metrics at the outputs belong to another gate."""
    junit_file = config.reports / LATEST / "junit.xml"
    outputs = {"reports": (config.reports, junit_file, r'<testsuite name="([^"]*)"')}
    if config.metrics is not None:
        outputs["metrics"] = (config.metrics, config.metrics, r'[{,]nightly="([^"]*)"')
    for name, (output, file, pattern) in outputs.items():
        try:
            match = re.search(pattern, file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if match and match[1] != config.name:
            raise RequestError(
                f"{config.source}: output.{name}: {output} belongs to the gate {match[1]!r}; "
                f"give {config.name!r} a different path"
            )


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RequestError(f"{path}: {error.strerror or error}") from error


def _is_current(path: Path, data: bytes) -> bool:
    with suppress(FileNotFoundError):
        return path.read_bytes() == data
    return False


def _set_latest(link: Path, target: str) -> bool:
    """Point `latest` to the newest night: a link, or a copy where links are not supported."""
    if link.is_symlink() and os.readlink(link) == target:
        return False
    _remove_temporaries(link)
    temporary = link.with_name(f".{link.name}.{secrets.token_hex(8)}")
    try:
        try:
            temporary.symlink_to(target)
        except OSError:
            return _copy_latest(link, target, temporary)
        temporary.replace(link)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        raise RequestError(f"{link}: {error.strerror or error}") from error
    return True


def _remove_temporaries(link: Path) -> None:
    """Remove what killed processes have left; the caller holds the lock of the history."""
    for left in link.parent.glob(f".{link.name}.*"):
        if _TEMPORARY.fullmatch(left.suffix) is None:
            continue
        if left.is_dir() and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)
        else:
            with suppress(OSError):
                left.unlink()


def _copy_latest(link: Path, target: str, temporary: Path) -> bool:
    names = sorted(path.name for path in (link.parent / target).iterdir())
    same = link.is_dir() and all(
        (link / name).is_file() and (link / name).read_bytes() == path.read_bytes()
        for name in names for path in [link.parent / target / name]
    )  # fmt: skip
    if same:
        return False
    shutil.copytree(link.parent / target, temporary)
    shutil.rmtree(link, ignore_errors=True)
    temporary.replace(link)
    return True
