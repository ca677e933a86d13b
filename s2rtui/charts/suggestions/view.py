"""What `s2r suggest` found about the run: changes of either side, and what each gains."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from s2rstore.errors import RequestError, sentence
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rstore.suggestions import AIMS, read_report
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Canvas, Panel, Point, RenderOptions, Size, Theme
from s2rtui.charts.scene import Scene
from s2rtui.charts.suggestions.model import Direction, SuggestionsInput
from s2rtui.charts.suggestions.terminal import draw_suggestions, suggestions_panels
from s2rtui.charts.view import Pane, Pixels, Table, View
from s2rtui.session import Session, suggestions

_COLUMNS = (
    "for", "answer", "changes", "values", "factors", "low_m", "gain_m", "high_m", "price_m",
    "low_share", "gain_share", "high_share", "price_share", "evident", "suggested",
)  # fmt: skip


class SuggestionsView(View):
    name = "suggestions"
    key = "J"
    pane: Pane = "centre"
    description = "stored answers of s2r suggest: what would help, and how much"
    brushable = False
    counts_instances = False
    narrow_ratio = 2.6
    wide_ratio = 0.75
    figure_size = (1600, 1000)

    def subtitle(self, scene: Scene) -> str:
        has_answers = self.input(scene).chosen_index is not None
        return f"changes that would help{' (enter: apply)' if has_answers else ''}"

    def input(self, scene: Scene) -> SuggestionsInput:
        state = scene.state
        return SuggestionsInput(_directions(scene.store, state.run), state.suggestion)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        return (self.input(scene), scene.state.view == self.name)

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_suggestions(self.input(scene), size, options, scene.state.view == self.name)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        return suggestions_panels(self.input(scene), size, options)

    def click(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        clicked, chosen = round(point[1]), self.input(scene).chosen_index
        if chosen is not None and clicked >= 0:
            session.dispatch(suggestions.choose, clicked - chosen)

    def numbers(self, scene: Scene) -> Table:
        return _COLUMNS, [_row(direction, number) for direction, number in self.input(scene).places]

    def summary(self, scene: Scene) -> str:
        parts = [
            f"{sentence(direction.aim)}: "
            f"{direction.note or (direction.report and direction.report.verdict)}."
            for direction in self.input(scene).directions
        ]
        return f"{scene.state.run}. {' '.join(parts)}"

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.suggestions import paper

        title = f"{scene.state.run}: what would help"
        directions = self.input(scene).directions
        if all(direction.report is None for direction in directions):
            notes = "; ".join(direction.note for direction in directions)
            raise RequestError(f"--view {self.name}: {notes}")
        return paper.suggestions_figure(directions, size, theme, title, scene.store.dataset.name)


VIEW = SuggestionsView()


@cached_by_identity(4)
def _directions(store: Store, run: str) -> tuple[Direction, ...]:
    return tuple(_direction(store, run, side) for side in reversed(SIDES))


def _direction(store: Store, run: str, side: Side) -> Direction:
    record = store.run(run)
    try:
        record.network("suggest")
        report = read_report(store, run, side)
    except RequestError as error:
        return Direction(side, AIMS[side], note=str(error))
    if report is None:
        command = shlex.join(["s2r", "suggest", store.path.name, "--run", run, "--for", side])
        return Direction(side, AIMS[side], note=f"no stored result; `{command}` computes one")
    commands = [answer.command(str(store.path), record, side) for answer in report.answers]
    return Direction(side, AIMS[side], report, tuple(commands))


def _row(direction: Direction, number: int) -> tuple[object, ...]:
    report, answer = direction.report, direction.answers[number]
    assert report is not None
    price = len(answer.changes) * report.price_of_a_change
    figures = (answer.gain.low, answer.gain.value, answer.gain.high, price)
    unknown = (None,) * len(figures)
    both = (*figures, *unknown) if direction.side == "real" else (*unknown, *figures)
    return (
        direction.side, number + 1, len(answer.changes), answer.changes_text,
        ", ".join(answer.factors), *both, "yes" if answer.evident else "no",
        "yes" if report.best == number else "no",
    )  # fmt: skip
