"""iTerm2's protocol: an image file from the cursor's cell, scaled to a box of cells.

https://iterm2.com/documentation-images.html
"""

from __future__ import annotations

from base64 import standard_b64encode

from s2rtui.canvas import Size


def inline_file(content: bytes, cells: Size) -> str:
    """The escape sequence that draws an image file over the box `cells` (columns, rows)."""
    data = standard_b64encode(content).decode("ascii")
    keys = (
        f"inline=1;size={len(content)};width={cells[0]};height={cells[1]};"
        "preserveAspectRatio=0;doNotMoveCursor=1"
    )
    return f"\x1b]1337;File={keys}:{data}\x07"
