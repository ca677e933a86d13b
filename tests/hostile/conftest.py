"""A store in which every free text column is hostile, and the markup that is parsed."""

from pathlib import Path

import pytest
import rich.markup
import rich.text
from textual.content import Content

from tests.support import hostile


@pytest.fixture(scope="session")
def hostile_store(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with hostile texts and a history, which no test modifies; see `hostile.HOSTILE`."""
    folder = tmp_path_factory.mktemp("poisoned")
    return hostile.with_nights(
        hostile.with_hostile_texts(tiny_store, folder / "bad [ [@click=app.quit]x.s2r")
    )


@pytest.fixture
def no_foreign_markup(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Records markup from a store that is parsed; the list must stay empty."""
    foreign: list[str] = []
    original = Content.from_markup

    def from_markup(markup: str | Content, **variables: object) -> Content:
        if any(sign in str(markup) for sign in ("CLICK", "[/ ", "@click")):
            foreign.append(str(markup))
        return original(markup, **variables)

    def recording_render(markup: str, *options: object, **keywords: object) -> rich.text.Text:
        if any(sign in markup for sign in ("CLICK", "[/ ", "@click")):
            foreign.append(markup)
        return rich.text.Text(markup)

    monkeypatch.setattr(Content, "from_markup", staticmethod(from_markup))
    monkeypatch.setattr(rich.markup, "render", recording_render)
    monkeypatch.setattr(rich.text, "render", recording_render, raising=False)
    return foreign
