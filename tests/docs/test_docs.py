"""The documentation refers to what exists, shows present outputs, builds as a site and runs."""

import asyncio
import base64
import importlib.util
import re
import shlex
import subprocess
import sys
import tomllib
from io import BytesIO
from itertools import zip_longest
from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from s2rtui.cli import main
from tests.support import notebooks
from tests.support.chromium import browser, missing_program
from tests.support.copies import copy_store

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES]
_COMMAND = re.compile(r"^(?:\$ )?s2r (?P<rest>.*)$", re.MULTILINE)
_BLOCK = re.compile(r"^```[a-z]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(?<!`)\[[^\]]*\]\((?P<target>[^)\s]+)\)")
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e-?\d+)?")
_PATH = re.compile(r"`(?P<path>(?:s2rtui|store|tools|tests|examples|docs|bench)/[^`\s]*)`")


_FIELD = """
{const field = document.querySelector("input.md-search__input"); field && field.focus();
document.activeElement === field && document.readyState === "complete"}
"""
_FOUND = """
[...document.querySelectorAll(".md-search-result__item h1, .md-search-result__item h2")]
  .map((each) => each.textContent)
"""


def script(name: str):
    """The module of a script of the documentation."""
    spec = importlib.util.spec_from_file_location(f"docs_{name}", DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_all_files_name_the_same_release():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    release, _, development = project["version"].partition(".dev")
    heading = re.search("^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1]
    assert heading == (f"{release} (in development)" if development else release)
    ros_package = ElementTree.parse(ROOT / "tools" / "s2rtools" / "ros" / "launch" / "package.xml")
    assert ros_package.findtext("version") == release


def shown_commands(text: str) -> list[list[str]]:
    """The arguments after `s2r` of every command in the code blocks of a page."""
    lines = [match["rest"] for block in _BLOCK.findall(text) for match in _COMMAND.finditer(block)]
    return [shlex.split(line, comments=True) for line in lines]


def documented_options(commands_page: str) -> dict[str, set[str]]:
    """The options of every command in the generated page."""
    sections = re.split(r"^## s2r (\w+).*$", commands_page, flags=re.MULTILINE)
    return {
        name: set(re.findall(r"--[\w-]+", body))
        for name, body in zip(sections[1::2], sections[2::2], strict=True)
    }


def test_the_readme_has_at_most_150_lines():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_shown_commands_and_their_options_exist():
    options = documented_options(script("generate").commands_page())
    unknown = []
    for page in TEXTS:
        for arguments in shown_commands(page.read_text(encoding="utf-8")):
            name = "tui" if arguments[0].endswith(".s2r") else arguments[0]
            known = options.get(name, set()) | {"--help", "--debug", "--version"}
            flags = {
                argument.partition("=")[0] for argument in arguments if argument.startswith("--")
            }
            if name not in options and arguments[0] not in ("--help", "--version"):
                unknown.append((page.name, arguments[0]))
            unknown += [(page.name, name, flag) for flag in sorted(flags - known)]
    assert not unknown


def test_expressions_of_shown_commands_parse():
    from s2rstore.language import parse

    for page in TEXTS:
        for arguments in shown_commands(page.read_text(encoding="utf-8")):
            expressions = [
                arguments[i + 1] for i, argument in enumerate(arguments) if argument == "--select"
            ]
            if arguments[0] == "query":
                expressions.append(arguments[2])
            for expression in expressions:
                parse(expression)


def test_links_between_pages_resolve():
    generated = set(script("generate").PAGES)
    broken = []
    for page in TEXTS:
        for match in _LINK.finditer(page.read_text(encoding="utf-8")):
            target = match["target"].partition("#")[0]
            if not target or "://" in target:
                continue
            file = (page.parent / target).resolve()
            inside = file.is_relative_to(DOCS) and str(file.relative_to(DOCS)) in generated
            if not file.exists() and not inside:
                broken.append((page.name, match["target"]))
    assert not broken


def test_named_paths_exist():
    missing = []
    for page in TEXTS:
        for match in _PATH.finditer(page.read_text(encoding="utf-8")):
            path = match["path"]
            if not any(placeholder in path for placeholder in ("NAME", "FOLDER", "<")):
                missing += [] if (ROOT / path).exists() else [(page.name, path)]
    assert not missing


def test_registry_names_beside_their_files_exist():
    missing = []
    for page in TEXTS:
        pairs = re.findall(r"`([A-Z_]+)` in `([^`]+\.py)`", page.read_text(encoding="utf-8"))
        for name, path in pairs:
            if not re.search(
                rf"^{name}\b", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE
            ):
                missing.append((page.name, name, path))
    assert not missing


def test_the_key_reference_and_the_cheat_sheet_list_every_action():
    from s2rtui.app.key_bindings import ACTIONS

    pages = script("generate")
    keys, sheet = pages.keys_page(), pages.cheat_sheet_page()
    for action in ACTIONS:
        if action.description:
            assert pages.cell(action.description) in keys
            assert pages.html.escape(action.description) in sheet


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    for package in ("mkdocs", "material", "mkdocstrings"):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} is not installed: the site is not built")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    folder = tmp_path_factory.mktemp("built") / "site"
    process = subprocess.run(
        [*command, "--site-dir", str(folder)],
        cwd=ROOT, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert process.returncode == 0, process.stdout + process.stderr
    return folder


@pytest.mark.deep
def test_the_site_lists_its_pages_for_agents_and_loads_no_external_resources(site):
    listed = (site / "llms.txt").read_text(encoding="utf-8")
    assert all((site / page).is_file() for page in re.findall(r"\]\((.+?)\)", listed))
    sources = r"<(?:script|img|iframe|source)[^>]*\ssrc=[\"']?(?:https?:)?//[^\"'> ]+"
    links = r"<link[^>]*rel=[\"']?(?:stylesheet|preconnect|icon)[^>]*href=[\"']?https?://[^\"'> ]+"
    loaded = re.compile(f"{sources}|{links}")
    for page in site.rglob("*.html"):
        assert not loaded.findall(page.read_text(encoding="utf-8")), page
    for style in site.rglob("*.css"):
        assert not re.findall(r"url\([\"']?https?://", style.read_text(encoding="utf-8")), style


@pytest.mark.deep
@pytest.mark.skipif(bool(missing_program()), reason="there is no chromium")
async def test_search_works_on_pages_that_are_opened_from_a_file(site, tmp_path):
    async with asyncio.timeout(60), browser(tmp_path / "profile") as page:
        await page.open((site / "how-to" / "scripts.html").as_uri())
        while not await page.evaluate(_FIELD):
            await asyncio.sleep(0.1)
        for letter in "conformal":
            await page.press(letter)
        while not (found := await page.evaluate(_FOUND)):
            await asyncio.sleep(0.1)
        assert any("uncertainty" in title for title in found)
        assert not page.failures
        assert not [url for url in page.requests if not url.startswith(("file:", "data:"))]


NOTEBOOK = Path(__file__).parents[2] / "examples" / "store.ipynb"


@pytest.mark.usefixtures("declared_entry_points")
def test_all_cells_run_on_a_small_store(tiny_store, monkeypatch):
    monkeypatch.setenv("S2R_STORE", str(tiny_store))
    outputs = [output for cell in notebooks.run(notebooks.code_cells(NOTEBOOK)) for output in cell]
    shown = [output["data"] for output in outputs if output["output_type"] == "execute_result"]
    assert any(line.startswith("  data set: ") for line in shown[0]["text/plain"])
    pictures = [data["image/png"] for data in shown if "image/png" in data]
    assert len(pictures) == 2
    for picture in pictures:
        assert Image.open(BytesIO(base64.b64decode(picture))).width == round(120 / 25.4 * 110)


def test_the_notebook_holds_outputs_and_no_machine_path():
    cells = notebooks.code_cells(NOTEBOOK)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert sum("image/png" in output.get("data", {}) for c in cells for output in c["outputs"]) == 2
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert not any(folder in text for folder in ("/home/", "/tmp/", "/root/", "/work/", "/Users/"))
    assert NOTEBOOK.stat().st_size < 400_000


@pytest.mark.deep
def test_shown_outputs_are_those_of_the_demo(tmp_path):
    """Words are equal, and numbers but for the last digits, in which processors differ."""
    outputs = script("update_outputs")
    assert main(["demo", "--out", str(tmp_path / "demo"), "--no-open"]) == 0
    compared = 0
    for page in outputs.PAGES:
        for block in outputs._BLOCK.finditer(page.read_text(encoding="utf-8")):
            fresh = outputs.output(block["command"], tmp_path / "demo" / "world.s2r")
            for shown, printed in zip_longest(block["output"].splitlines(), fresh.splitlines()):
                where = f"{page.name}, {block['command']}: {shown!r} against {printed!r}"
                assert shown is not None, where
                assert printed is not None, where
                assert _words(shown) == _words(printed), where
                numbers = [list(map(float, _NUMBER.findall(line))) for line in (shown, printed)]
                assert numbers[0] == pytest.approx(numbers[1], rel=0.02, abs=0.02), where
            compared += 1
    assert compared >= 3


def _words(line: str) -> list[str]:
    return re.sub(r"-{2,}", "-", _NUMBER.sub("0", line)).split()


@pytest.mark.parametrize("title", ["Tables", "Train on a store", "Test screens of your own"])
def test_examples_of_scripts_run(tiny_store, tmp_path, monkeypatch, title):
    copy_store(tiny_store, tmp_path / "lab.s2r")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("S2R_UPDATE_SCREENS", "1")
    page = (DOCS / "how-to" / "scripts.md").read_text(encoding="utf-8")
    (section,) = re.findall(rf"^## {title}$(.*?)(?=^## )", page, re.DOTALL | re.MULTILINE)
    (example,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    if "DataLoader" in example:  # it forks, which this process with its threads must not do
        subprocess.run([sys.executable, "-c", example], check=True)
        return
    exec(example, {})
    if (stored := Path("tests/screens/rooms.txt")).exists():
        monkeypatch.delenv("S2R_UPDATE_SCREENS")
        exec(example, {})
        stored.write_text("another line")
        with pytest.raises(AssertionError, match="-another line"):
            exec(example, {})
