"""Replace the outputs of `$ s2r ...` blocks in README and tutorial by those of the demo store.

    python docs/update_outputs.py demo-out/world.s2r

Blocks that show no output, or write a file, stay as they are.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "README.md", ROOT / "docs" / "tutorial.md")
_BLOCK = re.compile(r"^```\n\$ s2r (?P<command>[^\n]*)\n(?P<output>[^$`][^`]*?)^```", re.MULTILINE)


def output(command: str, store: Path) -> str:
    """Standard output and standard error of a shown command, run on `store`."""
    words = [str(store) if word.endswith("world.s2r") else word for word in shlex.split(command)]
    run = [sys.executable, "-m", "s2rtui", *words]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout + done.stderr


def main() -> None:
    """Rewrite both pages."""
    store = Path(sys.argv[1]).resolve()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        fresh = _BLOCK.sub(
            lambda block: f"```\n$ s2r {block['command']}\n{output(block['command'], store)}```",
            text,
        )
        page.write_text(fresh, encoding="utf-8")
        print(f"{page.relative_to(ROOT)}: {'updated' if fresh != text else 'unchanged'}")


if __name__ == "__main__":
    main()
