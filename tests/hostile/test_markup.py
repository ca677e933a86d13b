"""External texts are never parsed as markup by Textual, rich or matplotlib."""

import ast
from collections.abc import Iterator
from pathlib import Path

import s2rtui

SOURCES = Path(s2rtui.__file__).parent
WIDGETS = {"Static", "Label", "Button", "Checkbox", "Link", "OptionList", "SelectionList"}
TEXTS = {"Option", "Selection", "Toast", "Notification"}


def calls() -> Iterator[tuple[str, str, ast.Call]]:
    """The location, name and node of every call in the application."""
    for path in sorted(SOURCES.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        uses_textual = any(
            isinstance(node, ast.ImportFrom) and (node.module or "").startswith("textual")
            for node in ast.walk(tree)
        )
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                name = node.func.attr if isinstance(node.func, ast.Attribute) else (
                    node.func.id if isinstance(node.func, ast.Name) else ""
                )  # fmt: skip
                location = f"{path.relative_to(SOURCES)}:{node.lineno}"
                yield location, name if uses_textual or name != "update" else "", node


def disables_markup(call: ast.Call) -> bool:
    """Whether a call has `markup=False`."""
    return any(
        keyword.arg == "markup"
        and isinstance(keyword.value, ast.Constant)
        and keyword.value.value is False
        for keyword in call.keywords
    )


def is_content(call: ast.Call) -> bool:
    """Whether the first argument of a call is built by `Content` without its markup parser."""
    argument = call.args[0] if call.args else None
    if not isinstance(argument, ast.Call):
        return False
    function = ast.unparse(argument.func)
    return function in ("Content", "Content.assemble", "dict", "dict.fromkeys")


def test_no_widget_receives_a_string_with_markup_enabled():
    violations = []
    for location, name, call in calls():
        if (name in WIDGETS or (name == "notify" and call.args)) and not disables_markup(call):
            violations.append(f"{location}: {name} without markup=False")
        if name in TEXTS and not is_content(call):
            violations.append(f"{location}: {name} of a string")
        if name == "update" and call.args and not is_content(call):
            violations.append(f"{location}: update with a string")
        if name in ("from_markup", "print_markup", "rprint"):
            violations.append(f"{location}: {name}")
        if name == "TextColumn" and not disables_markup(call):
            violations.append(f"{location}: TextColumn without markup=False")
        if ast.unparse(call.func).endswith("console.print") and not disables_markup(call):
            violations.append(f"{location}: console.print without markup=False")
    assert not violations


def test_no_widget_sets_a_title_or_tooltip():
    attributes = {"tooltip", "border_title", "border_subtitle", "title", "sub_title"}
    violations = []
    for path in sorted(SOURCES.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "from textual" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            targets = node.targets if isinstance(node, ast.Assign) else ()
            violations += [f"{path.name}:{t.lineno} {t.attr}" for t in targets
                      if isinstance(t, ast.Attribute) and t.attr in attributes]  # fmt: skip
    assert not violations
