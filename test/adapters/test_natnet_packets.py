"""NatNet's packets: recorded ones and made ones, against another decoder; damaged ones."""

import random

import numpy as np
import pytest
from helpers import natnet_server
from helpers.capture_files import capture_file

from hand_tracker.adapters import natnet_packets
from hand_tracker.adapters.natnet_packets import (
    frame_packet,
    message_id,
    model_definitions,
    server_info,
)
from hand_tracker.adapters.point_frame import MalformedFrame

VERSIONS = (3, 0), (3, 1), (4, 0), (4, 1)
MARKER_SETS = {'RHand': np.array([[.1, .2, .3], [-1., 2., -3.]], 'f4'),
               'cup': np.ones((1, 3), 'f4')}
NAMES = {'RHand': ('wrist', 'index mcp'), 'cup': ('rim',)}
NAMELESS = np.array([[7., 8., 9.], [.5, .25, .125]], 'f4')


def other_decoder(kind, data, version):
    """Return what the package natnet makes of a packet."""
    natnet = pytest.importorskip('natnet', reason='natnet, the other decoder, is not installed')
    from natnet.packet_buffer import PacketBuffer
    from natnet.server_info import ServerInfo
    from natnet.version import Version
    buffer = PacketBuffer(data)
    buffer.pointer = 4
    kinds = {'frame': natnet.DataFrame, 'model': natnet.DataDescriptions, 'info': ServerInfo}
    return kinds[kind].read_from_buffer(buffer, Version(*version))


def made_frame(version, **more):
    return natnet_server.frame(version, 42, MARKER_SETS, NAMELESS, exposure=123456789012,
                               transmit=123456799999, **more)


def sets_of(frame):
    """Return the positions of each marker set of a frame, and those of the labelled markers."""
    names, counts = zip(*frame.structure.sets) if frame.structure.sets else ((), ())
    *sets, labelled = np.split(frame.markers, np.cumsum(counts, dtype=int))
    assert len(labelled) == len(frame.structure.labelled)
    return dict(zip(names, sets)), labelled


def check_frame(data, version):
    """Check a frame against the other decoder's; return it."""
    expected = other_decoder('frame', data, version)
    found = frame_packet(data, version)
    assert message_id(data) == natnet_packets.FRAME
    assert found.number == expected.prefix.frame_number
    named, labelled = sets_of(found)
    sets = [each for each in expected.marker_sets if each.model_name != 'all']
    assert list(named) == [each.model_name for each in sets]
    for positions, each in zip(named.values(), sets):
        np.testing.assert_array_equal(positions, np.reshape(each.marker_pos_list, (-1, 3)))
    bodies = [each for each in expected.labeled_markers if each.model_id and not each.unlabeled]
    assert list(found.structure.labelled) == [
        (each.model_id, each.marker_id) for each in bodies]
    for position, each in zip(labelled, bodies):
        np.testing.assert_array_equal(position, (np.nan,) * 3 if each.occluded else each.pos)
    taken = {each.pos for each in expected.labeled_markers}
    free = [at for at in expected.unlabeled_marker_pos if at not in taken]
    free += [each.pos for each in expected.labeled_markers if each.unlabeled]
    np.testing.assert_array_equal(found.points, np.reshape(free, (-1, 3)))
    assert found.exposure == expected.suffix.stamp_camera_mid_exposure
    assert found.transmit == expected.suffix.stamp_transmit
    if version < (4, 1):  # of which the other decoder forgets the precision time before it
        assert found.models_changed == expected.suffix.tracked_models_changed
    return found


@pytest.mark.parametrize('version', VERSIONS)
def test_frames_are_decoded_as_by_another_decoder(version):
    found = check_frame(made_frame(version), version)
    np.testing.assert_array_equal(sets_of(found)[0]['RHand'], MARKER_SETS['RHand'])
    np.testing.assert_array_equal(found.points, [*NAMELESS, natnet_server.LONELY])
    assert found.exposure == 123456789012
    alone = check_frame(made_frame(version, has_sets=False, occluded=[('cup', 0)]), version)
    assert not alone.structure.sets and len(alone.points) == 3
    assert frame_packet(made_frame(version, changed=True), version).models_changed


@pytest.mark.parametrize('version', VERSIONS)
def test_occluded_markers_are_missing(version):
    found, _ = sets_of(frame_packet(made_frame(version, occluded=[('RHand', 1)]), version))
    np.testing.assert_array_equal(found['RHand'], [MARKER_SETS['RHand'][0], [np.nan] * 3])
    np.testing.assert_array_equal(found['cup'], MARKER_SETS['cup'])


@pytest.mark.parametrize('version', (*VERSIONS, (4, 2)))
def test_names_are_decoded_as_by_another_decoder(version):
    data = natnet_server.model(version, NAMES)
    expected = other_decoder('model', data, version)
    found = model_definitions(data, version)
    assert found.sets == NAMES == {
        each.name: each.marker_names for each in expected.marker_sets if each.name != 'all'}
    assert found.bodies == {each.id_num: each.name for each in
                            (*expected.rigid_bodies, *expected.skeletons)}


def test_server_information_has_the_frequency_of_its_clock():
    data = natnet_server.server_info((4, 1), 3312787, 1600, '239.255.42.99')
    found = server_info(data)
    assert found == ('Motive', (4, 1), 3312787., 1600, '239.255.42.99')
    expected = other_decoder('info', data, (4, 1))
    assert expected.application_name == found.name
    assert server_info(natnet_server.server_info((3, 0))).group == ''
    with pytest.raises(MalformedFrame, match=r'speaks version 2.10; expected 3 or 4'):
        server_info(natnet_server.server_info((2, 10)))
    with pytest.raises(MalformedFrame, match='the frequency'):
        server_info(natnet_server.server_info((3, 0), frequency=0))


def test_recorded_packets_are_decoded():
    data = capture_file('files/natnet_mocapframe_packet_v3.bin').read_bytes()
    frame = check_frame(data, (3, 0))
    assert frame.structure.sets == () and len(frame.points) == 1
    assert frame.structure.labelled == tuple((2, number) for number in range(1, 6))
    data = capture_file('files/natnet_modeldef_packet_v3.bin').read_bytes()
    model = model_definitions(data, (3, 0))
    assert model.bodies == {2: 'RaceQuad'}
    assert model.sets == {'RaceQuad': tuple(f'Marker{number}' for number in range(1, 6))}
    expected = other_decoder('model', data, (3, 0))
    assert expected.marker_sets[0].marker_names == model.sets['RaceQuad']
    info = server_info(capture_file('files/natnet_serverinfo_packet_v3.bin').read_bytes())
    assert info == ('Motive', (3, 0), 3312787., 1511, '239.255.42.99')


@pytest.mark.parametrize('version', VERSIONS)
def test_damaged_packets_are_refused_or_read(version):
    """Whatever the bytes are: an answer of the right form, or one clear error, and no hang."""
    drawn = random.Random(1)
    made = made_frame(version), natnet_server.model(version, NAMES)
    refused = 0
    for number in range(1500):
        data = bytearray(made[number % 2])
        if drawn.random() < .3:
            del data[drawn.randrange(4, len(data)):]
        for _ in range(drawn.randrange(1, 4)):
            data[drawn.randrange(4, len(data)) if len(data) > 4 else 0] = drawn.randrange(256)
        decode = (frame_packet, model_definitions)[number % 2]
        try:
            decode(bytes(data), version)
        except MalformedFrame as error:
            refused += 1
            assert 'at byte' in str(error) and 'expected' in str(error)
    assert refused > 300


def drawn_frame(random, version):
    """Return a frame of markers, occlusions, points and names that come and go."""
    sets = {name: random.normal(size=(count, 3)) for name, count in (
        ('RHand', 8), ('cup', random.choice((3, 3, 3, 2))))}
    occluded = [(name, row) for name, rows in sets.items() for row in range(len(rows))
                if random.random() < .01]
    return natnet_server.frame(
        version, random.integers(2**31), sets,
        random.normal(size=(random.choice((0, 0, 0, 2)), 3)), occluded,
        exposure=random.integers(2**40), transmit=random.integers(2**40),
        changed=random.random() < .2, has_sets=random.random() < .9)


def damaged(random, data):
    """Return a packet with some of its bytes changed, or cut."""
    found = bytearray(data)
    for _ in range(random.integers(1, 4)):
        found[random.integers(4, len(found))] = random.integers(256)
    return bytes(found[:len(found) if random.random() < .8 else random.integers(4, len(found))])


def result(decode, *given):
    """Return what a decoder finds, without its structure, or its error, in bytes."""
    try:
        with np.errstate(invalid='ignore'):  # signalling NaN
            found = decode(*given)
    except MalformedFrame as error:
        return str(error), None
    return tuple(part.tobytes() if isinstance(part, np.ndarray) else part for part in found
                 if part is not found.structure), found.structure


@pytest.mark.parametrize('version', VERSIONS)
def test_frames_are_the_same_by_the_structure_of_the_last(version):
    random, last, reused, refused = np.random.default_rng(5), None, 0, 0
    for _ in range(3000):
        data = drawn_frame(random, version)
        if random.random() < .2:
            data = damaged(random, data)
        expected, alone = result(frame_packet, data, version)
        found, structure = result(frame_packet, data, version, last)
        assert found == expected
        if structure is None:
            refused += 1
            continue
        assert (structure.sets, structure.labelled) == (alone.sets, alone.labelled)
        reused += structure is last
        last = structure
    assert reused > 400 and refused > 100


@pytest.mark.parametrize('size', [0, 1, 3, 5, 100])
def test_a_packet_of_another_size_than_it_says_is_refused(size):
    with pytest.raises(MalformedFrame, match='expected'):
        message_id(made_frame((3, 0))[:size])
