"""What a session may do, asked in one place, and made to hold for the whole process."""

from s2rtui.access.rights import Access
from s2rtui.own import own_folder

__all__ = ["Access", "own_folder"]
