"""Find the files that robots name: of a path, a package:// address, the meshes of a URDF."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote
from xml.etree import ElementTree

from ..files.plain_xml import parse_plain_xml
from .robot_urdf import InvalidRobot

PACKAGE_SCHEME = 'package://'
FILE_SCHEME = 'file://'
ELEMENTS_OF_FILES = 'mesh', 'texture'   # of a URDF: those with a file's name


class AddressedUrdf(NamedTuple):
    """A URDF whose files another program can find.

    Attributes
    ----------
    text : str
        XML.
    missing : tuple of str
        Names of files that are not found, as the URDF has them, each once.
    """

    text: str
    missing: tuple[str, ...]


def resolve_path(text: str, folder: Path) -> Path:
    """Return the file of a path, a path relative to a folder, or a package:// path.

    Raises
    ------
    InvalidRobot
        If the package is in none of the prefixes of AMENT_PREFIX_PATH, or a home is not known.
    """
    if not text.startswith(PACKAGE_SCHEME):
        try:
            return folder / Path(text).expanduser()
        except RuntimeError as error:  # '~somebody' whom this machine does not know
            raise InvalidRobot(f'{text}: {error}') from None
    package, rest = _package_and_rest(text)
    share = _package_share(package)
    if share is None:
        raise InvalidRobot(f"{text}: there is no package '{package}'; source its workspace, or "
                           'give a path')
    return share / rest


def with_file_addresses(urdf: str, folder: Path | None) -> AddressedUrdf:
    """Return a URDF in which the names of its meshes and textures can be resolved anywhere.

    RViz and others take addresses: ``package://`` of an installed package, which is left as it is,
    and ``file://``, which every other file that is found is named by. A package that is not
    installed is looked for beside the URDF and in the folders above it, by its name and, as
    checkouts have other names, by the path in it.

    Parameters
    ----------
    urdf : str
        XML.
    folder : Path, optional
        Of the URDF; None where it has none, and only absolute names can be found.

    Raises
    ------
    NotPlainXml
        If it is none.
    """
    robot = parse_plain_xml(urdf)
    missing: dict[str, None] = {}
    has_changed = False
    for element in robot.iter():
        name = element.get('filename')
        if element.tag not in ELEMENTS_OF_FILES or not name:
            continue
        address = _address(name, folder)
        if address is None:
            missing[name] = None
        elif address != name:
            element.set('filename', address)
            has_changed = True
    text = ElementTree.tostring(robot, encoding='unicode') if has_changed else urdf
    return AddressedUrdf(text, tuple(missing))


def _address(name: str, folder: Path | None) -> str | None:
    """Return the address of a file that a URDF names; None where there is no such file."""
    if name.startswith(PACKAGE_SCHEME):
        package, rest = _package_and_rest(name)
        share = _package_share(package)
        if share is not None:
            return name if os.path.isfile(share / rest) else None
        folders = () if folder is None else (folder, *folder.parents)
        places = [above / inner for above in folders for inner in (f'{package}/{rest}', rest)]
    elif name.startswith(FILE_SCHEME):
        return name if os.path.isfile(unquote(name[len(FILE_SCHEME):])) else None
    elif '://' in name:  # elsewhere, such as http://
        return name
    elif folder is None and not Path(name).is_absolute():
        return None
    else:
        places = [(folder or Path()) / name]
    # Unlike Path's, this isfile takes whatever a URDF may hold.
    return next((place.resolve().as_uri() for place in places if os.path.isfile(place)), None)


def _package_and_rest(text: str) -> tuple[str, str]:
    """Return the package and the path in it of a package:// address."""
    package, _, rest = text[len(PACKAGE_SCHEME):].partition('/')
    return package, rest


def _package_share(package: str) -> Path | None:
    """Return the folder of a package's shared files; None where it is not installed."""
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        if (share := Path(prefix) / 'share' / package).is_dir():
            return share
    return None
