"""What a keystore must have before nodes are started with it."""

import pytest

from hand_tracker.files.keystore import (
    ENCLAVE_FILES,
    InvalidKeystore,
    enclave_of,
    security_environment,
)


def keystore(folder, program='tracker', names=ENCLAVE_FILES):
    enclave = folder / 'enclaves' / 'hand_tracker' / program
    enclave.mkdir(parents=True)
    for name in names:
        (enclave / name).touch()
    return str(folder)


def test_a_node_is_enforced_with_the_keystore_given_or_that_of_the_environment(
        tmp_path, monkeypatch):
    path = keystore(tmp_path)
    environment = security_environment(path)
    assert environment == {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
                           'ROS_SECURITY_KEYSTORE': path}
    assert enclave_of(environment, 'tracker') == '/hand_tracker/tracker'
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', path)
    assert security_environment('') == environment


def test_nothing_is_started_unsecured_by_mistake(tmp_path, monkeypatch):
    monkeypatch.delenv('ROS_SECURITY_KEYSTORE', raising=False)
    for given in '', str(tmp_path), str(tmp_path / 'none'):
        with pytest.raises(InvalidKeystore, match='expected a folder with enclaves'):
            security_environment(given)
    environment = security_environment(keystore(tmp_path, names=ENCLAVE_FILES[1:]))
    with pytest.raises(InvalidKeystore, match='tracker lacks cert.pem; expected the enclave'):
        enclave_of(environment, 'tracker')
    with pytest.raises(InvalidKeystore, match='replay lacks'):
        enclave_of(environment, 'replay')
