"""System identification: estimate a simulator's parameters from recorded drives."""

from s2rtools.sysid.identify import Identification, identify
from s2rtools.sysid.report import record
from s2rtools.sysid.settings import SysidSettings
from s2rtools.sysid.synthetic_drives import Recording, make_drives

__all__ = ["Identification", "Recording", "SysidSettings", "identify", "make_drives", "record"]
