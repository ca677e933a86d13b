"""Check that a release installs, runs and is documented: `make release-check`.

`build/release` gets wheel and source archive, the documentation in `site`, `licences.txt` and
`sbom.json` (CycloneDX) of what the wheel installs, `SHA256SUMS`, and `check.log` with the output of
all commands. The wheel is installed into an empty virtual environment and runs in an empty folder.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tarfile
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "build" / "release"
LOG = OUT / "check.log"
ENVIRONMENT = OUT / "environment"
EMPTY = OUT / "empty"
PACKAGES = ("s2rtui", "s2rstore", "s2rtools")
DATA_SUFFIXES = {".py", ".typed", ".lark", ".md", ".tcss", ".css", ".html", ".js", ".toml"}
"""What a package may hold besides the models and the files of ROS."""
MODELS = "s2rtools/training/checkpoints/"
CLASSIFIER = "License :: OSI Approved :: "
INSTANCES = 12
SECONDS: dict[str, float] = {}


class ReleaseError(Exception):
    """What is wrong with the release."""


@contextmanager
def step(name: str) -> Iterator[None]:
    """Time a step under its name."""
    print(f"{name} ...", flush=True)
    began = time.monotonic()
    yield
    SECONDS[name] = time.monotonic() - began


def run(*command: str | Path, folder: Path = ROOT) -> str:
    """The output of a command, which must succeed; the log holds it, too.

    Variables that would import other modules or name other settings are not inherited.
    """
    hidden = ("PYTHON", "S2R_", "VIRTUAL_ENV", "XDG_")
    variables = {k: v for k, v in os.environ.items() if not k.startswith(hidden)}
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=folder, env=variables, capture_output=True, text=True)
    with LOG.open("a", encoding="utf-8") as log:
        log.write(f"$ {' '.join(words)}\n{done.stdout}{done.stderr}\n")
    if done.returncode:
        lines = (done.stdout + done.stderr).strip().splitlines()[-5:]
        raise ReleaseError("\n".join([f"{' '.join(words)}: exit code {done.returncode}", *lines]))
    return done.stdout


def build() -> Path:
    """Build the source archive, and the wheel from it; returns the wheel."""
    run(sys.executable, "-m", "build", "--outdir", OUT, ROOT)
    (wheel,) = OUT.glob("*.whl")
    return wheel


def check_contents(wheel: Path) -> None:
    """Compare wheel and source archive with the packages.

    Raises ReleaseError where a module is missing or a file of development is included.
    """
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    (source,) = OUT.glob("*.tar.gz")
    with tarfile.open(source) as tar:
        sources = [member.name.partition("/")[2] for member in tar.getmembers() if member.isfile()]
    unknown = [name for name in names if not _belongs(name)]
    unknown += [name for name in sources if name.startswith(("tests/", "bench/", "examples/"))]
    if unknown:
        raise ReleaseError(f"{len(unknown)} files do not belong in a release: {unknown[:5]}")
    modules = {f.relative_to(ROOT / folder).as_posix() for package, folder in
               zip(PACKAGES, ("", "store", "tools"), strict=True)
               for f in (ROOT / folder / package).rglob("*.py")}  # fmt: skip
    if missing := sorted(modules - set(names)):
        raise ReleaseError(f"{wheel.name} lacks {len(missing)} modules: {missing[:5]}")
    print(f"  {wheel.name}: {len(names)} files, {wheel.stat().st_size / 1e6:.1f} MB")
    print(f"  {source.name}: {len(sources)} files, {source.stat().st_size / 1e6:.1f} MB")


def _belongs(name: str) -> bool:
    first, _, rest = name.partition("/")
    if first.endswith(".dist-info"):
        return True
    is_data = name.startswith((MODELS, "s2rtools/ros/launch/"))
    return first in PACKAGES and (is_data or Path(rest).suffix in DATA_SUFFIXES)


def install(wheel: Path) -> Path:
    """Install the wheel with the extra `tools` into an empty environment; returns its folder."""
    run(sys.executable, "-m", "venv", ENVIRONMENT)
    pip = ENVIRONMENT / "bin" / "pip"
    run(pip, "install", "--constraint", "constraints.txt", "torch")
    run(pip, "install", "--constraint", "constraints.txt", f"{wheel}[tools]")
    run(pip, "check")
    return ENVIRONMENT / "bin"


def check_programs(programs: Path, version: str) -> None:
    """Run the installed program in an empty folder."""
    EMPTY.mkdir()
    s2r = programs / "s2r"
    place = run(programs / "python", "-c", "import s2rtui; print(s2rtui.__file__)", folder=EMPTY)
    if not Path(place.strip()).is_relative_to(ENVIRONMENT):
        raise ReleaseError(f"the environment imports {place.strip()}, not the wheel")
    if version not in (printed := run(s2r, "--version", folder=EMPTY)):
        raise ReleaseError(f"s2r --version prints {printed.strip()}, the wheel has {version}")
    run(s2r, "doctor", folder=EMPTY)
    run(s2r, "demo", "--no-open", "--instances", str(INSTANCES), folder=EMPTY)
    store = EMPTY / "demo-out" / "world.s2r"
    run(s2r, "verify", store, folder=EMPTY)
    runs = json.loads(run(s2r, "runs", "--json", store, folder=EMPTY))
    pictures = sorted(each.name for each in (EMPTY / "demo-out").glob("*.png"))
    if len(runs) < 4 or len(pictures) < 4:
        raise ReleaseError(
            f"the demo made {len(runs)} runs and {len(pictures)} pictures; 4 each expected"
        )
    print(f"  demo of {INSTANCES} instances: {len(runs)} runs, {len(pictures)} pictures")


def write_licences() -> None:
    """Write `sbom.json` of the environment, and `licences.txt` from it."""
    sbom = OUT / "sbom.json"
    run(Path(sys.executable).with_name("cyclonedx-py"), "environment", "--pyproject",
        ROOT / "pyproject.toml", "--output-reproducible", "-o", sbom,
        ENVIRONMENT / "bin" / "python")  # fmt: skip
    parts = json.loads(sbom.read_text(encoding="utf-8"))["components"]
    rows = sorted((part["name"].lower(), part["version"], _licence(part)) for part in parts)
    width = max(len(name) for name, _, _ in rows)
    lines = [f"{name:{width}}  {version:14}  {licence}" for name, version, licence in rows]
    (OUT / "licences.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    unknown = [name for name, _, licence in rows if not licence]
    print(f"  {len(rows)} packages; without a stated licence: {', '.join(unknown) or 'none'}")


def _licence(part: dict[str, Any]) -> str:
    """The licences that a component states, the most exact statement first."""
    stated = []
    for each in part.get("licenses", ()):
        licence = each.get("license", {})
        texts = each.get("expression"), licence.get("id"), licence.get("name")
        rank = next(i for i, text in enumerate(texts) if text)
        stated.append((rank, " ".join(texts[rank].split()).removeprefix(CLASSIFIER)))
    return min(stated)[1] if stated else ""


def write_checksums() -> None:
    """Write `SHA256SUMS` of the files that a release publishes."""
    files = sorted([*OUT.glob("*.whl"), *OUT.glob("*.tar.gz"), *OUT.glob("*.json"),
                    *OUT.glob("licences.txt")])  # fmt: skip
    sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}" for file in files]
    (OUT / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")


def main() -> int:
    """Run all steps; returns 1, and names what is wrong, at the first that fails."""
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    try:
        with step("build"):
            wheel = build()
            check_contents(wheel)
        with step("install into an empty environment"):
            programs = install(wheel)
        with step("run from the wheel alone"):
            check_programs(programs, wheel.name.split("-")[1])
        with step("documentation"):
            run(Path(sys.executable).with_name("mkdocs"), "build", "--strict", "--quiet",
                "--site-dir", OUT / "site")  # fmt: skip
        with step("licences and bill of materials"):
            write_licences()
            write_checksums()
    except ReleaseError as error:
        print(f"release-check: {error}\nsee {LOG}", file=sys.stderr)
        return 1
    for name, seconds in SECONDS.items():
        print(f"{seconds:7.1f} s  {name}")
    print(f"{sum(SECONDS.values()):7.1f} s  in all; the files are in {OUT}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
