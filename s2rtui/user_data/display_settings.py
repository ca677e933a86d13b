"""Display settings of a user: the theme and the symbols of `s2r tui`, kept between starts."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files.atomic_writes import write_file
from s2rtui.user_data import user_data_dir

_MAX_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class DisplaySettings:
    """Names of a theme and of a set of symbols; None where the user chose none."""

    theme: str | None = None
    symbols: str | None = None


def settings_path() -> Path:
    """Return the path of the settings, `display.json` in the user data folder."""
    return user_data_dir() / "display.json"


def read_settings() -> DisplaySettings:
    """Return the stored settings; without values where there is no readable file."""
    path = settings_path()
    if not path.is_file():  # reading a pipe would wait
        return DisplaySettings()
    try:
        with open(path, encoding="utf-8") as file:
            stored = json.loads(file.read(_MAX_BYTES))
    except (OSError, ValueError, RecursionError):
        return DisplaySettings()
    if not isinstance(stored, dict):
        return DisplaySettings()
    names = {field.name: stored.get(field.name) for field in fields(DisplaySettings)}
    return DisplaySettings(**{
        name: value for name, value in names.items() if isinstance(value, str)
    })  # fmt: skip


def write_settings(settings: DisplaySettings) -> None:
    """Store the settings. Raises RequestError where the file cannot be written."""
    path = settings_path()
    chosen = {name: value for name, value in asdict(settings).items() if value is not None}
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_file(path, json.dumps(chosen, indent=1).encode() + b"\n")
    except OSError as error:
        raise RequestError(f"{path}: the settings cannot be written ({error})") from error
