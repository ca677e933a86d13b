"""Malicious and damaged weights files, and models that break the expected interface."""

import io
import os
import pickle
import warnings
import zipfile
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from s2rtools.models import build_network
from s2rtui.cli import main
from tests.hostile.inputs import deadline, limits
from tests.support.copies import copy_store


def pipe(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(1 << 40)


@pytest.mark.parametrize("suffix", [".safetensors", ".pt"])
@pytest.mark.parametrize("make_file", [pipe, device, sparse])
def test_an_invalid_weights_file_is_rejected(tmp_path, tiny_store, capsys, make_file, suffix):
    path = tmp_path / f"w{suffix}"
    make_file(path)
    with deadline():
        assert add(tiny_store, path) == 2
    assert capsys.readouterr().err.startswith(f"s2r: {path}: ")


def add(store: Path, path: Path, *more: str) -> int:
    arch = () if "--arch" in more else ("--arch", "resposenet")
    return main(["model", "add", "--store", str(store), "m", str(path), *arch, *more])


def archive(state: dict[str, torch.Tensor], method: int, extra: int = 0) -> bytes:
    """A weights file packed with another compression method or with `extra` bytes of zeros."""
    uncompressed, packed = io.BytesIO(), io.BytesIO()
    torch.save(state, uncompressed)
    with zipfile.ZipFile(uncompressed) as source, zipfile.ZipFile(packed, "w", method) as target:
        for entry in source.infolist():
            target.writestr(entry.filename, source.read(entry))
        if extra:
            with target.open("archive/data/999", "w") as entry:
                for _ in range(extra >> 20):
                    entry.write(bytes(1 << 20))
    return packed.getvalue()


def test_a_compressed_archive_is_rejected(tmp_path, tiny_store, capsys):
    path = tmp_path / "w.pt"
    path.write_bytes(
        archive(build_network("resposenet").state_dict(), zipfile.ZIP_DEFLATED, 64 << 20)
    )
    assert add(tiny_store, path) == 2
    assert "compressed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda value: value.to_sparse(), "not a plain tensor"),
        (lambda value: value.to(torch.complex64), "not a plain tensor"),
        (lambda value: value.to(torch.int64), "expected torch.float32"),
        (lambda value: value[..., :0], "wrong shape"),
        (lambda value: value.new_full((1,), 0.0).expand(10**6, 10**6), "wrong shape"),
        (lambda value: torch.empty_like(value, device="meta"), "not a plain"),
    ],
    ids=["sparse", "complex", "integers", "empty", "expanded", "meta"],
)
def test_unexpected_tensors_are_rejected(tmp_path, tiny_store, capsys, change, expected):
    state = build_network("resposenet").state_dict()
    key = next(key for key, value in state.items() if value.ndim == 4)
    path = tmp_path / "w.pt"
    torch.save({**state, key: change(state[key])}, path)
    assert add(tiny_store, path) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"s2r: {path}: ")
    assert expected in error


class RunsCommand:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("exit 1",)


def test_a_malicious_or_truncated_pickle_is_rejected(tmp_path, tiny_store, capsys):
    path = tmp_path / "w.pt"
    before = limits()
    malicious = [pickle.dumps(RunsCommand(), protocol) for protocol in (0, 2, 5)]
    for content in (*malicious, pickle.dumps(bytearray(1))[:-1]):
        path.write_bytes(content)
        with warnings.catch_warnings(record=True) as shown:
            warnings.simplefilter("always")
            assert add(tiny_store, path) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"s2r: {path}: ")
        assert error.count("\n") == 1
        assert [str(warning.message) for warning in shown] == []
    assert limits() == before


class OneRow(nn.Module):
    """Returns one pose regardless of the batch size."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x.mean(dim=(0, 2, 3))[None]


class FailsOnBatches(nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if len(x) > 1:
            raise KeyError("only one image")
        return x.mean(dim=(2, 3))


def one_row() -> nn.Module:
    return OneRow()


def fails() -> nn.Module:
    return FailsOnBatches()


@pytest.mark.parametrize("factory", ["one_row", "fails"])
def test_a_model_that_does_not_support_batches_is_named(trained_store, tmp_path, capsys, factory):
    store, path = copy_store(trained_store, tmp_path / "s.s2r"), tmp_path / "w.safetensors"
    save_file({}, path)
    arch = f"tests.hostile.test_weights:{factory}"
    options = ("--arch", arch, "--trust", "--convention", "cos_sin")
    assert add(store, path, *options) == 0
    assert main(["run", "add", "--store", str(store), "m", "--model", "m"]) == 0
    capsys.readouterr()
    code = main(["precompute", str(store), "--run", "m", "--trust", "--workers", "1"])
    error = capsys.readouterr().err
    assert code == 2, error
    assert "model 'm'" in error
    assert "Traceback" not in error
