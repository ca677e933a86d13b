"""Find ROS: the packages of Debian or of a ROS installation, and which version is present."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError

SYSTEM_PACKAGES = "/usr/lib/python3/dist-packages"
"""Where Debian installs the Python packages of ROS 1."""
ROS1_PACKAGE = Path(__file__).parent / "launch"
"""Folder of the ROS 1 package with the launch file; it belongs into ROS_PACKAGE_PATH."""
DEBIAN_PACKAGES = (
    "python3-rospy",
    "python3-sensor-msgs",
    "python3-diagnostic-msgs",
    "python3-rosmaster",
    "python3-roslaunch",
)


def find_ros(wanted: str = "auto") -> int:
    """The version of ROS to use, 1 or 2; `wanted` is "auto", "1" or "2".

    With "auto", ROS_VERSION decides where it is set, else ROS 1 comes first. Raises RequestError if
    that version is not installed.
    """
    preferred = os.environ.get("ROS_VERSION", "") if wanted == "auto" else wanted
    versions = [int(preferred)] if preferred in ("1", "2") else [1, 2]
    for version in versions:
        if _is_installed("rospy" if version == 1 else "rclpy"):
            return version
    install = " ".join(DEBIAN_PACKAGES)
    if versions == [2]:
        raise RequestError("ROS 2: rclpy cannot be imported; source the setup.bash of ROS 2 first")
    raise RequestError(
        f"ROS: rospy cannot be imported; run `apt install {install}`, or source the setup.bash "
        "of your ROS"
    )


def ros_module(name: str) -> Any:
    """Import a module of ROS. Raises RequestError if it is missing."""
    _add_system_packages()
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0].replace("_", "-")
        raise RequestError(
            f"ROS: {name} cannot be imported ({error}); run `apt install python3-{package}`"
        ) from error


def _is_installed(name: str) -> bool:
    _add_system_packages()
    return importlib.util.find_spec(name) is not None


def _add_system_packages() -> None:
    """Append the system's packages to the import path, behind those of this environment."""
    if os.path.isdir(SYSTEM_PACKAGES) and SYSTEM_PACKAGES not in sys.path:
        sys.path.append(SYSTEM_PACKAGES)
