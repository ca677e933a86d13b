"""Weights that lie about themselves, and models that do not do what they should."""

from __future__ import annotations

import io
import os
import pickle
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import nn

from s2rtools.models import build_network
from s2rtui.cli import main
from tests.hostile.inputs import deadline, limits


def pipe(path: Path) -> None:
    os.mkfifo(path)


def folder(path: Path) -> None:
    path.mkdir()


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(1 << 40)


def long_header(path: Path) -> None:
    path.write_bytes(struct.pack("<Q", 1 << 60) + b"{}")


def cut(path: Path) -> None:
    from safetensors.torch import save

    content = save({k: v.clone() for k, v in build_network("resposenet").state_dict().items()})
    path.write_bytes(content[: len(content) // 2])


@pytest.mark.parametrize("suffix", [".safetensors", ".pt"])
@pytest.mark.parametrize("made", [pipe, folder, device, sparse])
def test_what_is_no_weights_file_is_refused(
    tmp_path: Path, tiny_store: Path, capsys: pytest.CaptureFixture[str],
    made: Callable[[Path], None], suffix: str,
) -> None:  # fmt: skip
    path = tmp_path / f"w{suffix}"
    made(path)
    with deadline():
        assert add(tiny_store, path) == 2
    assert capsys.readouterr().err.startswith(f"s2r: {path}: ")


def add(store: Path, path: Path, *more: str) -> int:
    arch = () if "--arch" in more else ("--arch", "resposenet")
    return main(["model", "add", "--store", str(store), "m", str(path), *arch, *more])


@pytest.mark.parametrize("made", [long_header, cut])
def test_damaged_safetensors_are_refused(
    tmp_path: Path, tiny_store: Path, capsys: pytest.CaptureFixture[str],
    made: Callable[[Path], None],
) -> None:  # fmt: skip
    path = tmp_path / "w.safetensors"
    made(path)
    assert add(tiny_store, path) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"s2r: {path}: not a ")
    assert len(told.splitlines()) == 1


def archive(state: dict[str, torch.Tensor], method: int, extra: int = 0) -> bytes:
    """A weights file packed anew, with another method or with so many zeros more."""
    plain, made = io.BytesIO(), io.BytesIO()
    torch.save(state, plain)
    with zipfile.ZipFile(plain) as source, zipfile.ZipFile(made, "w", method) as target:
        for entry in source.infolist():
            target.writestr(entry.filename, source.read(entry))
        if extra:
            with target.open("archive/data/999", "w") as entry:
                for _ in range(extra >> 20):
                    entry.write(bytes(1 << 20))
    return made.getvalue()


def test_a_compressed_archive_is_refused(
    tmp_path: Path, tiny_store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "w.pt"
    path.write_bytes(
        archive(build_network("resposenet").state_dict(), zipfile.ZIP_DEFLATED, 64 << 20)
    )
    assert add(tiny_store, path) == 2
    assert "compressed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "word"),
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
def test_tensors_of_another_kind_are_refused(
    tmp_path: Path, tiny_store: Path, capsys: pytest.CaptureFixture[str], change, word: str
) -> None:
    state = build_network("resposenet").state_dict()
    key = next(key for key, value in state.items() if value.ndim == 4)
    path = tmp_path / "w.pt"
    torch.save({**state, key: change(state[key])}, path)
    assert add(tiny_store, path) == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith(f"s2r: {path}: ")
    assert word in told


class Runs:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("exit 1",)


def test_a_pickle_that_runs_code_or_claims_memory_is_refused(
    tmp_path: Path, tiny_store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "w.pt"
    before = limits()
    for content in (pickle.dumps(Runs()), pickle.dumps(bytearray(1))[:-1]):
        path.write_bytes(content)
        assert add(tiny_store, path) == 2
        assert capsys.readouterr().err.startswith(f"s2r: {path}: ")
    assert limits() == before


class OneRow(nn.Module):
    """Gives one pose for however many images; its author tried it with one."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x.mean(dim=(0, 2, 3))[None]


class Fails(nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if len(x) > 1:
            raise KeyError("only one image")
        return x.mean(dim=(2, 3))


def one_row() -> nn.Module:
    return OneRow()


def fails() -> nn.Module:
    return Fails()


@pytest.mark.parametrize("factory", ["one_row", "fails"])
def test_a_model_that_answers_for_another_number_of_images_is_named(
    trained_store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], factory: str
) -> None:
    import shutil

    store, path = tmp_path / "s.s2r", tmp_path / "w.safetensors"
    shutil.copytree(trained_store, store)
    from safetensors.torch import save_file

    save_file({}, path)
    arch = f"tests.hostile.test_weights:{factory}"
    words = ("--arch", arch, "--trust", "--convention", "cos_sin")
    assert add(store, path, *words) == 0
    assert main(["run", "add", "--store", str(store), "m", "--model", "m"]) == 0
    capsys.readouterr()
    code = main(["precompute", str(store), "--run", "m", "--trust", "--workers", "1"])
    told = capsys.readouterr().err
    assert code == 2, told
    assert "model 'm'" in told
    assert "Traceback" not in told
