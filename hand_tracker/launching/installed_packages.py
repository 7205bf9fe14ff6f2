"""Whether a launch finds a package's nodes, before it starts any."""

from __future__ import annotations

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory


def is_installed(package: str) -> bool:
    """Return whether a package is installed."""
    try:
        get_package_share_directory(package)
    except PackageNotFoundError:
        return False
    return True
