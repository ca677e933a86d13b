"""Compiled numba functions of libraries are cached between processes."""

import importlib

import numba

from s2rtools.common.numba_cache import cached


def test_libraries_imported_in_the_context_are_cached(tmp_path, monkeypatch):
    code = "import numba\n@numba.njit\ndef twice(x):\n    return 2 * x\n"
    for name in ("kept_library", "plain_library"):
        (tmp_path / f"{name}.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    with cached():
        cached_library = importlib.import_module("kept_library")
    other_library = importlib.import_module("plain_library")
    assert (cached_library.twice(2), other_library.twice(2)) == (4, 4)
    files = [path.name for path in (tmp_path / "cache").rglob("*.nbc")]
    assert files
    assert all("kept_library" in name for name in files)
