"""A manifest cannot refer to files outside its folder."""

from pathlib import Path

import pytest

from tests.support import pairs
from tests.support.refusals import CommandResult, RunCommand


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    return pairs.manifest(tmp_path / "data", n=4)


@pytest.fixture
def ingest(s2r: RunCommand) -> RunCommand:
    """Ingest a manifest, or a folder, into a store beside its folder."""

    def run(path: Path, *more: object, layout: str = "csv") -> CommandResult:
        store = (path if path.is_dir() else path.parent).parent / "s.s2r"
        return s2r("ingest", layout, path, "--store", store, "--size", 32, *more)

    return run


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
    manifest, ingest, redirect
):
    redirect(manifest)
    ingest(manifest).assert_refused(f"{manifest}:2: rgb", "--allow-outside")
    assert not (manifest.parent.parent / "s.s2r").exists()
    allowed = ingest(manifest, "--allow-outside")
    elsewhere = manifest.parent.parent.resolve() / "elsewhere"
    assert allowed.code == 0
    assert f"read from outside the data folder: {elsewhere} (" in allowed.err


def test_a_link_inside_the_folder_is_followed(manifest, ingest):
    folder = manifest.parent
    (folder / "sim" / "0_rgb.png").rename(folder / "kept.png")
    (folder / "sim" / "0_rgb.png").symlink_to(folder / "kept.png")
    assert ingest(manifest).code == 0


@pytest.mark.parametrize("link", [False, True])
def test_an_outside_floor_plan_is_rejected(manifest, ingest, link):
    header = manifest.with_suffix(".toml")
    target = move_outside(manifest, "sim/0_rgb.png")
    name = "plan.png" if link else str(target)
    if link:
        (manifest.parent / name).symlink_to(target)
    header.write_text(f'floor_plan = "{name}"\n' + header.read_text())
    ingest(manifest).assert_refused(f"{header}: floor_plan")


@pytest.mark.parametrize("moved_part", ["image", "folder", "match.csv", "map.jpg"])
def test_outside_links_in_the_sim2realviz_layout_are_rejected(tmp_path, ingest, moved_part):
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
    words = tmp_path / "data", "--header", header
    ingest(*words, layout="sim2realviz").assert_refused("leads out of this folder")
    assert ingest(*words, "--allow-outside", layout="sim2realviz").code == 0


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
def test_an_invalid_csv_file_is_rejected_in_one_line(tmp_path, ingest, content, expected):
    (tmp_path / "data").mkdir()
    path = tmp_path / "data" / "m.csv"
    path.write_bytes(content)
    ingest(path).assert_refused(f"s2r: {path}", expected)
