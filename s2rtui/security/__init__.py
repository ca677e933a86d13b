"""Permissions of a session, and their enforcement in the whole process."""

from s2rtui.security.permissions import Capability, Permissions

__all__ = ["Capability", "Permissions"]
