"""A manifest cannot refer to files outside its folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rtui.cli import main
from tests.support import pairs


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    return pairs.manifest(tmp_path / "data", n=4)


def ingest(path: Path, *more: str, layout: str = "csv") -> int:
    store = (path if path.is_dir() else path.parent).parent / "s.s2r"
    return main(["ingest", layout, str(path), "--store", str(store), "--size", "32", *more])


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def move_outside(manifest: Path, name: str) -> Path:
    """Move an image of the data set out of its folder."""
    target = manifest.parent.parent / "elsewhere" / Path(name).name
    target.parent.mkdir(exist_ok=True)
    (manifest.parent / name).rename(target)
    return target


def absolute(manifest: Path) -> None:
    replace(manifest, "sim/0_rgb.png", str(move_outside(manifest, "sim/0_rgb.png")))


def relative_to_parent(manifest: Path) -> None:
    move_outside(manifest, "sim/0_rgb.png")
    replace(manifest, "sim/0_rgb.png", "../elsewhere/0_rgb.png")


def linked(manifest: Path) -> None:
    target = move_outside(manifest, "sim/0_rgb.png")
    (manifest.parent / "sim" / "0_rgb.png").symlink_to(target)


@pytest.mark.parametrize("redirect", [absolute, relative_to_parent, linked])
def test_a_row_with_an_outside_path_is_rejected_with_its_line_number_unless_allowed(
    manifest: Path, capsys: pytest.CaptureFixture[str], redirect
) -> None:
    redirect(manifest)
    assert ingest(manifest) == 2
    error = capsys.readouterr().err
    assert f"{manifest}:2: rgb" in error
    assert "--allow-outside" in error
    assert not (manifest.parent.parent / "s.s2r").exists()
    assert ingest(manifest, "--allow-outside") == 0
    elsewhere = manifest.parent.parent.resolve() / "elsewhere"
    assert f"read from outside the data folder: {elsewhere} (" in capsys.readouterr().err


def test_a_link_inside_the_folder_is_followed(manifest: Path) -> None:
    folder = manifest.parent
    (folder / "sim" / "0_rgb.png").rename(folder / "kept.png")
    (folder / "sim" / "0_rgb.png").symlink_to(folder / "kept.png")
    assert ingest(manifest) == 0


@pytest.mark.parametrize("link", [False, True])
def test_an_outside_floor_plan_is_rejected(
    manifest: Path, capsys: pytest.CaptureFixture[str], link: bool
) -> None:
    header = manifest.with_suffix(".toml")
    target = move_outside(manifest, "sim/0_rgb.png")
    name = "plan.png" if link else str(target)
    if link:
        (manifest.parent / name).symlink_to(target)
    header.write_text(f'floor_plan = "{name}"\n' + header.read_text())
    assert ingest(manifest) == 2
    assert f"{header}: floor_plan" in capsys.readouterr().err


@pytest.mark.parametrize("moved_part", ["image", "folder", "match.csv", "map.jpg"])
def test_outside_links_in_the_sim2realviz_layout_are_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], moved_part: str
) -> None:
    header = pairs.sim2realviz(tmp_path / "data", n=4)
    sim = tmp_path / "data" / "traj1" / "sim"
    if moved_part == "map.jpg":
        moved = tmp_path / "data" / "map.jpg"
        (tmp_path / "secret.jpg").write_bytes(next(sim.glob("*_rgb.jpeg")).read_bytes())
    else:
        names = {
            "image": next(sim.glob("*_rgb.jpeg")),
            "folder": sim,
            "match.csv": sim / moved_part,
        }
        moved = names[moved_part]
        moved.rename(tmp_path / "secret.jpg")
    moved.symlink_to(tmp_path / "secret.jpg")
    options = "--header", str(header)
    assert ingest(tmp_path / "data", *options, layout="sim2realviz") == 2
    assert "leads out of this folder" in capsys.readouterr().err
    assert ingest(tmp_path / "data", *options, "--allow-outside", layout="sim2realviz") == 0


COLUMNS = b"trajectory,seq,domain,rgb,depth,x,y,heading"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (COLUMNS + b"\n\0\0\0\n", "NUL"),
        (b"a," * 5000 + b"\n", "columns"),
        (COLUMNS + b"\n" + b"x" * (2 << 20) + b"\n", "longer than"),
        (COLUMNS + b'\n"' + b"x\n" * (1 << 19), "field"),
        (COLUMNS + b"\n\xff\xfe\n", "UTF-8"),
    ],
    ids=["nul", "columns", "line", "field", "encoding"],
)
def test_an_invalid_csv_file_is_rejected_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes, expected: str
) -> None:
    (tmp_path / "data").mkdir()
    path = tmp_path / "data" / "m.csv"
    path.write_bytes(content)
    assert ingest(path) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"s2r: {path}")
    assert expected in error
    assert len(error.splitlines()) == 1
