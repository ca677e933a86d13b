"""Refuse actions that the session's permissions do not allow."""

from __future__ import annotations

from collections.abc import Mapping

from textual import actions
from textual.actions import ActionParseResult
from textual.app import App
from textual.dom import DOMNode

from s2rtui.app.key_bindings import find_action
from s2rtui.security.permissions import Permissions
from s2rtui.terminal.textual_compat import QuietApp

_HARMLESS = frozenset(
    {"bell", "command_palette", "focus", "focus_next", "focus_previous", "help_quit", "quit"}
)
"""Actions of Textual that neither write a file nor leave the screen."""


class GuardedApp(QuietApp):
    """Checks every action, wherever it is called from; few actions of Textual are allowed."""

    access: Permissions

    def show_error(self, text: str) -> None:
        """Show why an action was refused."""
        raise NotImplementedError

    def refusal(self, name: str, parameters: tuple[object, ...] = ()) -> str:
        """Why an action may not run; empty if it may."""
        if not self.access.restricted:
            return ""
        built_in = getattr(App, f"action_{name}", None)
        is_replaced = getattr(type(self), f"action_{name}", None) is not built_in
        if built_in is not None and not is_replaced and name not in _HARMLESS:
            return f"not in a restricted session: {name.replace('_', ' ')}"
        action = find_action(name, parameters)
        if action is None or self.access.allows(action.needs):
            return ""
        return f"not in a restricted session: {action.description}"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        return not self.refusal(action, parameters) and super().check_action(action, parameters)

    async def run_action(
        self,
        action: str | ActionParseResult,
        default_namespace: DOMNode | None = None,
        namespaces: Mapping[str, DOMNode] | None = None,
    ) -> bool:
        space, name, parameters = actions.parse(action) if isinstance(action, str) else action
        if space == "app" or (not space and default_namespace in (None, self)):
            reason = self.refusal(name, parameters)
            if reason:
                self.show_error(reason)
                return True
        with self.surviving_errors():
            return await super().run_action(action, default_namespace, namespaces)
        return True
