"""Meshes of a robot's URDF, named so that another program finds them."""

from xml.etree import ElementTree

import pytest

from hand_tracker.retargeting.robot_paths import with_file_addresses
from hand_tracker.retargeting.robot_urdf import read_urdf_tree

URDF = """<robot name="robot"><material name="skin"><texture filename="{}"/></material>
<link name="palm"><visual><geometry><mesh filename="{}" scale="0.001 0.001 0.001"/></geometry>
</visual></link></robot>"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return the folder of a package that is not installed, with its URDF's folder and a mesh."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    folder = tmp_path / 'some work' / 'robot_description'
    (folder / 'urdf').mkdir(parents=True)
    (folder / 'meshes').mkdir()
    (folder / 'meshes' / 'palm.stl').touch()
    return folder


def names(text):
    """Return the files that a URDF names."""
    return [element.get('filename') for element in ElementTree.fromstring(text).iter()
            if element.get('filename')]


@pytest.mark.parametrize('name', [
    '../meshes/palm.stl', './../meshes/palm.stl', 'package://robot_description/meshes/palm.stl',
    'package://name_of_another_checkout/meshes/palm.stl', '{package}/meshes/palm.stl'])
def test_a_mesh_beside_the_urdf_gets_an_address(package, name):
    given = URDF.format('package://robot_description/meshes/palm.stl', name.format(package=package))
    found = with_file_addresses(given, package / 'urdf')
    address = (package / 'meshes' / 'palm.stl').as_uri()
    assert '%20' in address  # a blank has no place in an address
    assert names(found.text) == [address, address] and not found.missing
    assert ElementTree.fromstring(found.text).find('.//mesh').get('scale') == '0.001 0.001 0.001'
    # What has addresses stays as it is, wherever it goes.
    assert with_file_addresses(found.text, None) == found


def test_an_installed_package_is_left_to_the_other_program(package, tmp_path):
    share = tmp_path / 'prefix' / 'share' / 'robot_description'
    (share / 'meshes').mkdir(parents=True)
    (share / 'meshes' / 'palm.stl').touch()
    given = URDF.format('https://example.org/skin.png',
                        'package://robot_description/meshes/palm.stl')
    assert with_file_addresses(given, package / 'urdf') == (given, ())


def test_what_is_not_found_is_named_once_and_left_as_it_is(package, tmp_path):
    (tmp_path / 'prefix' / 'share' / 'installed').mkdir(parents=True)
    lost = ['package://installed/meshes/palm.stl', 'package://absent/palm.stl', 'palm.stl',
            'file:///nowhere/palm.stl', '/nowhere/palm.stl', '../meshes', 'package://', 'a' * 5000]
    given = '<robot name="robot">{}</robot>'.format(''.join(
        f'<link name="{i}"><visual><geometry><mesh filename="{name}"/></geometry></visual></link>'
        for i, name in enumerate([*lost, *lost])))
    assert with_file_addresses(given, package / 'urdf') == (given, tuple(lost))


def test_a_urdf_without_a_folder_has_only_what_is_absolute(package):
    mesh = package / 'meshes' / 'palm.stl'
    found = with_file_addresses(URDF.format(mesh, '../meshes/palm.stl'), None)
    assert names(found.text) == [mesh.as_uri(), '../meshes/palm.stl']
    assert found.missing == ('../meshes/palm.stl',)


def test_the_robot_is_the_same(package):
    given = URDF.format('', '../meshes/palm.stl').replace(
        '</robot>', '<link name="tip"/><joint name="bend" type="revolute"><parent link="palm"/>'
        '<child link="tip"/><limit lower="0" upper="1.5"/></joint></robot>')
    found = with_file_addresses(given, package / 'urdf')
    assert found.text != given
    before, after = map(read_urdf_tree, (given, found.text))
    assert after.links == before.links
    assert [joint.upper for joint in after.joints] == [1.5]
