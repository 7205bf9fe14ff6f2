"""SROS 2 keystore: its enclaves, and the environment that makes a node enforce security."""

from __future__ import annotations

import os
from pathlib import Path

from ..core.errors import HandTrackerError

ENCLAVE_FOLDER = 'hand_tracker'  # of the keystore's enclaves, one a program
# What `ros2 security generate_artifacts` writes, that the middleware reads.
ENCLAVE_FILES = 'cert.pem', 'key.pem', 'governance.p7s', 'permissions.p7s'


class InvalidKeystore(HandTrackerError, ValueError):
    """A keystore is not there, or lacks what a program needs."""


def security_environment(keystore: str) -> dict[str, str]:
    """Return the environment variables by which a node refuses to run unsecured.

    Parameters
    ----------
    keystore : str
        Folder; where it is empty, that of ROS_SECURITY_KEYSTORE.

    Raises
    ------
    InvalidKeystore
    """
    given = keystore or os.environ.get('ROS_SECURITY_KEYSTORE', '')
    if not given or not Path(given, 'enclaves').is_dir():
        raise InvalidKeystore(f"keystore: '{given}'; expected a folder with enclaves, as "
                              'docs/security.md makes it')
    return {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
            'ROS_SECURITY_KEYSTORE': str(Path(given).resolve())}


def enclave_of(environment: dict[str, str], program: str) -> str:
    """Return the enclave of a program.

    Parameters
    ----------
    environment : dict of str to str
        From `security_environment`.
    program : str
        Such as 'tracker'.

    Raises
    ------
    InvalidKeystore
        If the keystore lacks one of its files: the node would not start.
    """
    folder = Path(environment['ROS_SECURITY_KEYSTORE'], 'enclaves', ENCLAVE_FOLDER, program)
    if lacking := [name for name in ENCLAVE_FILES if not (folder / name).exists()]:
        raise InvalidKeystore(f'keystore: {folder} lacks {", ".join(lacking)}; expected the '
                              f"enclave '/{ENCLAVE_FOLDER}/{program}', as docs/security.md makes "
                              'it')
    return f'/{ENCLAVE_FOLDER}/{program}'
