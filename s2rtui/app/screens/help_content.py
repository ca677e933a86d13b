"""The content of the help screen and of the cheat sheet: questions, keys by group, terms."""

from __future__ import annotations

from dataclasses import dataclass

from s2rtui.app.action import GROUPS
from s2rtui.app.key_bindings import BY_NAME, permitted_actions
from s2rtui.security import Permissions

TERMS = {
    "instance": "one recorded pose with its images",
    "run": "one model on a sim and a real domain, with adjustments",
    "error": "distance between the predicted and the true position, m",
    "new instance": "one that the run's model was not trained on; views count only these",
    "trained instance": "one whose image the model was trained or chosen on; M includes them",
    "gap": "real error minus sim error, m",
    "shift": "distance between the sim and the real prediction, m",
    "outlier": "distance to similar images in the embedding; 1 is the median",
    "straight": "heading changes by less than 10 degrees over 7 images",
    "accuracy": "1 - error / scale of the data set, at least 0",
    "generation": "one published, unchangeable state of the store",
}
"""Terms of the project, explained in the help."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question of a user, and the actions that answer it, each with what it shows."""

    text: str
    steps: tuple[tuple[str, str], ...]

    @property
    def entries(self) -> list[tuple[str, str]]:
        """(key, text) pairs, one per step."""
        return [(_keys_of(names), text) for names, text in self.steps]


def _keys_of(names: str) -> str:
    """The keys of actions separated by blanks, in the same order."""
    return " ".join(BY_NAME[name].key for name in names.split())


QUESTIONS = (
    Question("Where is it worst?", (
        ("view('rooms')", "the rooms by median real error, the worst one first"),
        ("view('pivot') open_row", "by room and heading; enter selects the marked cell"),
        ("worst_real view('map') room_names", "the worst 15 % on the map, with room names"),
    )),
    Question("What is poor in sim but good in real?", (
        ("view('scatter')", "sim error against real error; the title counts them"),
        ("worst_sim intersect best_real", "the worst in sim that are among the best in reality"),
        ("view('sheet') picture", "their images; \\: sim, difference, heat"),
    )),
    Question("Which model is better where?", (
        ("all view('compare')", "this run and another on all instances, room by room"),
        ("other_run", "compare with the next run"),
    )),
    Question("What triggers it?", (
        ("worst_real view('shares')", "metres that each factor causes in the worst 15 %"),
        ("view('instance') next_heat", "images with heat; kind harm: metres of changed parts"),
        ("view('objects')", "metres that each class of labelled objects costs"),
    )),
    Question("What should change, and on which instances?", (
        ("findings open_row", "findings (?: not evident); enter selects the instances"),
        ("view('suggestions')", "changes that s2r suggest found; enter applies one"),
        ("view('pivot') figure", "instances by room and heading: where images lack"),
        ("write_selection", "write them as CSV, JSON or Parquet"),
    )),
)  # fmt: skip
"""The questions of the cheat sheet, each answered in at most six keys."""


def help_sections(access: Permissions | None = None) -> list[tuple[str, list[tuple[str, str]]]]:
    """The sections of the help: questions, permitted actions by group, terms; (key, text) pairs."""
    sections = [(question.text, question.entries) for question in QUESTIONS]
    for group, title in GROUPS.items():
        entries = [
            (action.all_keys, action.description)
            for action in permitted_actions(access)
            if action.group == group and action.description
        ]
        sections.append((title, entries))
    return [*sections, ("Terms", list(TERMS.items()))]


def help_lines(access: Permissions | None = None, searched: str = "") -> list[str]:
    """The lines of the help, with a title above each section.

    `searched` leaves the entries whose section, key or text holds all its words; one character
    finds a key.
    """
    lines: list[str] = []
    for title, entries in help_sections(access):
        found = [entry for entry in entries if _holds((title, *entry), searched)]
        if found:
            lines += [*([""] if lines else []), title]
            lines += [f"  {key:<18}{text}" for key, text in found]
    return lines


def _holds(entry: tuple[str, str, str], searched: str) -> bool:
    title, key, text = entry
    if len(searched) == 1:
        return searched in key.split()
    shown = f"{title} {key} {text}".lower()
    return all(word in shown for word in searched.lower().split())
