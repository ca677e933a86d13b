"""An application whose actions, wherever they are called from, ask the session's `Permissions`."""

from __future__ import annotations

from collections.abc import Mapping

from textual import actions
from textual.actions import ActionParseResult
from textual.app import App
from textual.dom import DOMNode

from s2rstore.security.printable_text import printable
from s2rtui.app.actions import named
from s2rtui.security.permissions import Permissions

# Of Textual's own actions, those that neither write a file nor leave the screen.
_HARMLESS = frozenset(
    {"bell", "command_palette", "focus", "focus_next", "focus_previous", "help_quit", "quit"}
)


class GuardedApp(App[None]):
    """Refuses what `access` does not allow, and says so; Textual's own actions by a list."""

    access: Permissions

    def tell_refusal(self, told: str) -> None:
        """Show why an action did not run."""
        self.notify(printable(told), severity="warning", markup=False)

    def refusal(self, name: str, parameters: tuple[object, ...] = ()) -> str:
        """Why an action of the application may not run; empty where it may."""
        if not self.access.restricted:
            return ""
        built_in = getattr(App, f"action_{name}", None)
        replaced = getattr(type(self), f"action_{name}", None) is not built_in
        if built_in is not None and not replaced and name not in _HARMLESS:
            return f"not in a restricted session: {name.replace('_', ' ')}"
        action = named(name, parameters)
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
            told = self.refusal(name, parameters)
            if told:
                self.tell_refusal(told)
                return True
        return await super().run_action(action, default_namespace, namespaces)
