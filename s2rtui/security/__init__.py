"""What a session may do, asked in one place, and made to hold for the whole process."""

from s2rtui.security.permissions import Access, Need

__all__ = ["Access", "Need"]
