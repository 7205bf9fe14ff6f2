"""Find the files that come with the package: config/, launch/, recordings/ and urdf/."""

from pathlib import Path

PACKAGE = 'hand_tracker'
RECORDINGS = {'right': 'recordings/demo.mcap', 'left': 'recordings/demo_left.mcap'}


def share_directory():
    """Return the folder that holds the data files belonging to this very code.

    A checkout is its own share directory. An installed package has it at
    ``PREFIX/share/hand_tracker``, where PREFIX is some folder above the code, whether colcon, pip
    or Debian put it there. So no ROS 2 is asked, and code and data always belong together.

    Returns
    -------
    Path

    Raises
    ------
    FileNotFoundError
        If the data files are not installed beside the code.
    """
    return _share_directory(Path(__file__).resolve().parent)


def packaged_recording(side='right'):
    """Return the recording of a hand that comes with the package.

    Parameters
    ----------
    side : {'right', 'left'}
        A hand is not tracked by the markers of its mirror image.

    Returns
    -------
    Path
    """
    return share_directory() / RECORDINGS[side]


def _share_directory(code):
    """Return the share directory of the package folder `code`."""
    checkout = code.parent
    if (checkout / 'package.xml').is_file() and (checkout / 'resource' / PACKAGE).is_file():
        return checkout
    for prefix in code.parents:
        installed = prefix / 'share' / PACKAGE
        if (installed / 'package.xml').is_file():
            return installed
    raise FileNotFoundError(
        f'no share/{PACKAGE} in any folder above {code}: install the package again')
