"""Modules that a test unloads, as if they had not been imported or not been installed."""

import sys
from collections.abc import Callable

import pytest


def unload_modules(monkeypatch: pytest.MonkeyPatch, chosen: Callable[[str], bool]) -> None:
    """Remove imported modules until the test ends.

    Each module is removed from `sys.modules` and from its package. A module that the test imports
    again would otherwise stay in its package after `sys.modules` has been restored, and later tests
    would see two copies of it.
    """
    for name in [name for name in sys.modules if chosen(name)]:
        package, _, attribute = name.rpartition(".")
        if package in sys.modules:
            monkeypatch.delattr(sys.modules[package], attribute, raising=False)
        monkeypatch.delitem(sys.modules, name)
