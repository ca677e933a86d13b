"""Images with their facts in the format that FiftyOne reads as `LegacyFiftyOneDataset`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from s2rstore.language import to_text
from s2rtui.export.other_programs.content import ExportContent, png_bytes


def write(content: ExportContent, path: Path) -> None:
    """Write `data/SIDE-IID.png`, `samples.json` and `metadata.json`.

    A sample has the side as a tag, those of the notebook, and the facts of its instance as fields.
    """
    data, samples = path / "data", list[dict[str, Any]]()
    data.mkdir()
    for side in content.domains:
        for frame in content.frames(side):
            name = f"{side}-{frame.iid:06d}.png"
            (data / name).write_bytes(png_bytes(frame.rgb))
            facts = content.facts(frame.iid)
            tags = [side, *facts.pop("tags", ())]
            samples.append({"filepath": f"data/{name}", "tags": tags, "side": side, **facts})
    about = {"dataset": content.store.dataset.name, "run": content.run,
             "expression": to_text(content.query.node)}  # fmt: skip
    metadata = {"name": content.store.dataset.name, "media_type": "image", "info": about}
    (path / "metadata.json").write_text(json.dumps(metadata), encoding="utf-8")
    (path / "samples.json").write_text(json.dumps({"samples": samples}), encoding="utf-8")
