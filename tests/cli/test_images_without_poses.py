"""Commands on a data set of images without poses."""

from pathlib import Path

import pytest

from s2rtui.cli import main
from tests.support import image_folders
from tests.support.copies import copy_store


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(image_folders.image_store(tmp_path_factory.mktemp("images")))


CSV = ("--format", "csv")


def test_rows_of_images_can_be_queried_and_verified(images, s2r):
    rows = s2r("query", images, "traj:real_night & seq < 2", *CSV).lines
    assert rows == ["iid,trajectory,seq,timestamp_s", "4,real_night,0,", "5,real_night,1,"]
    assert s2r("query", images, "traj:sim_loop", "--count").lines == ["5"]
    columns = s2r("query", images, "ids(0)", "--columns", "traj,x,real.rank", *CSV).lines
    assert columns == ["traj,x,real.rank", "real_day,,"]
    query = "SELECT domain, count(*) AS n FROM frame GROUP BY domain ORDER BY domain"
    assert s2r("sql", images, query, *CSV).lines == ["domain,n", "real,7", "sim,7"]
    assert len(s2r("runs", images, *CSV).lines) == 1
    assert s2r("verify", images).lines == [f"{images}: no damage found"]


def test_the_list_and_one_image_are_shown_and_drawn(images, tmp_path, s2r):
    rows = s2r("show", images, "list", "--select", "seq=1", "--ascending", *CSV).lines
    assert rows[0] == "iid,trajectory,seq"
    assert [row.split(",")[:2] for row in rows[1:]] == [
        ["1", "real_day"], ["5", "real_night"], ["8", "sim_city"], ["10", "sim_loop"],
    ]  # fmt: skip
    words = s2r("show", images, "instance", "--iid", "9", "--words").lines
    assert words == ["Instance 9 (sim_loop 0): image in sim."]
    for view in ("instance", "list", "workbench"):
        assert main(["export", images, "--view", view, "--out", str(tmp_path / f"{view}.png")]) == 0
        assert (tmp_path / f"{view}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "arguments",
    [
        ["show", "STORE", "map"],
        ["show", "STORE", "rooms", "--words"],
        ["export", "STORE", "--view", "errors", "--out", "OUT.png"],
        ["report", "STORE", "--select", "all", "--out", "OUT.html"],
        ["train", "--recipe", "vanilla", "--store", "STORE"],
        ["run", "add", "mine", "--model", "mine", "--store", "STORE"],
        ["precompute", "STORE"],
        ["gap", "STORE"],
        ["query", "STORE", "all", "--run", "vanilla"],
        ["snapshot", "STORE", "--run", "vanilla", "--out", "OUT.txt"],
    ],
    ids=lambda arguments: " ".join(arguments[:3]),
)
def test_what_needs_poses_is_refused_in_one_line(images, tmp_path, s2r, arguments):
    words = [word.replace("OUT", str(tmp_path / "a")) for word in arguments]
    s2r(*[images if word == "STORE" else word for word in words]).assert_refused(
        f"s2r: {images}: the data set has no poses"
    )
    assert not list(tmp_path.iterdir())


def test_a_translator_is_fitted_and_a_report_on_few_images_refused(images, tmp_path, capsys, s2r):
    store = str(copy_store(Path(images), tmp_path / "fit.s2r"))
    assert main(["translate", "fit", "mkl", "--store", store, "--name", "t"]) == 0
    capsys.readouterr()
    assert s2r("verify", store).lines == [f"{store}: no damage found"]
    s2r("translate", "report", "--store", store, "t").assert_refused(
        "domain sim has 7 images; judging needs 8"
    )
    noise = ["translate", "fit", "mkl", "--store", store, "--name", "u", "--depth-noise"]
    s2r(*noise).assert_refused("has no poses; --depth-noise needs poses")
