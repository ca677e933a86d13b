"""System identification: a simulator's parameters from recorded drives, and what they leave."""

from s2rtools.sysid.drives import Recording, make_drives
from s2rtools.sysid.identify import Identification, identify
from s2rtools.sysid.record import record
from s2rtools.sysid.settings import Settings

__all__ = ["Identification", "Recording", "Settings", "identify", "make_drives", "record"]
