"""What a session may do, asked in one place, and made to hold for the whole process."""

from s2rtui.security.permissions import Need, Permissions

__all__ = ["Need", "Permissions"]
