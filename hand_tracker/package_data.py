"""Paths of the package's data files: config/, launch/, recordings/ and urdf/."""

from pathlib import Path

PACKAGE_NAME = 'hand_tracker'
PACKAGED_RECORDINGS = {'right': 'recordings/demo.mcap', 'left': 'recordings/demo_left.mcap',
                       'both': 'recordings/demo_both.mcap'}


def share_directory() -> Path:
    """Return the share directory: the folder of the data files installed with this code.

    A checkout is its own share directory. An installed package has it at
    ``PREFIX/share/hand_tracker``, where PREFIX is a folder above the code, whether installed by
    colcon, pip or Debian. It is found without ROS 2, so that code and data always match.

    Returns
    -------
    Path

    Raises
    ------
    FileNotFoundError
        If the data files are not installed beside the code.
    """
    return _share_directory(Path(__file__).resolve().parent)


def packaged_recording(side: str = 'right') -> Path:
    """Return the packaged recording of a hand or of both.

    Parameters
    ----------
    side : {'right', 'left', 'both'}

    Returns
    -------
    Path
    """
    return share_directory() / PACKAGED_RECORDINGS[side]


def _share_directory(code: Path) -> Path:
    """Return the share directory of the package folder `code`."""
    checkout = code.parent
    if (checkout / 'package.xml').is_file() and (checkout / 'resource' / PACKAGE_NAME).is_file():
        return checkout
    for prefix in code.parents:
        installed = prefix / 'share' / PACKAGE_NAME
        if (installed / 'package.xml').is_file():
            return installed
    raise FileNotFoundError(
        f'no share/{PACKAGE_NAME} in any folder above {code}: install the package again')
