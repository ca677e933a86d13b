"""Functions of a deferred package are compiled on request, for the types that they name."""

from __future__ import annotations

import runpy

import numba
import pytest

from s2rtools.common import numba_cache


@pytest.mark.deep
def test_functions_are_compiled_ahead() -> None:
    runpy.run_module("s2rtools.precompute.compile_ahead", run_name="__main__")


@pytest.mark.parametrize("package", ["pynndescent", "another"])
def test_types_of_a_deferred_package_are_compiled_on_request(
    package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba_cache, "_deferred", [])
    with numba_cache.cached():
        decorate = numba.njit

    def double(x):  # type: ignore[no-untyped-def]
        return 2 * x

    double.__module__ = f"{package}.module"
    compiled = decorate("float32(float32)", cache=False)(double)
    assert bool(compiled.signatures) == (package == "another")
    numba_cache.compile_deferred()
    assert compiled.signatures == [(numba.float32,)]
    assert compiled(1) == 2
    with pytest.raises(TypeError):
        compiled("text")
