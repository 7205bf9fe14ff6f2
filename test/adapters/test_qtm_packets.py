"""QTM's frames as Qualisys' own package reads them; damaged ones; by the structure of the last."""

import struct

import numpy as np
import pytest
from helpers.qtm_server import COMPONENTS, QTM_DATA, data_packet

from hand_tracker.adapters.point_frame import MalformedFrame
from hand_tracker.adapters.qtm_packets import qtm_frame

NEEDS = ('qtm_rt',)


def drawn_packet(random):
    """Return a frame of components and markers that come and go."""
    ending = random.choice(('', '', '', 'res'))
    parts = {f'3d{ending}': random.normal(size=(random.choice((8, 8, 8, 5)), 3)),
             f'3dnolabels{ending}': random.normal(size=(random.choice((2, 2, 2, 0)), 3))}
    for rows in parts.values():
        rows[random.random(len(rows)) < .1] = np.nan
    if random.random() < .1:
        del parts[random.choice(list(parts))]
    return data_packet(random.integers(2**31), random.integers(2**40), parts)


def read_by_qtm_rt(packet):
    """Return the markers and points that Qualisys' package finds [mm]."""
    from qtm_rt.packet import QRTPacket
    found = QRTPacket(packet[8:])
    named = found.get_3d_markers() or found.get_3d_markers_residual() or (None, [])
    others = (found.get_3d_markers_no_label() or found.get_3d_markers_no_label_residual()
              or (None, []))
    return tuple(np.array([marker[:3] for marker in markers], float).reshape(-1, 3)
                 for _, markers in (named, others))


def result(packet, last=None):
    """Return what is found, without its structure, or the error, in bytes."""
    try:
        with np.errstate(invalid='ignore'):  # signalling NaN
            found = qtm_frame(packet, last)
    except MalformedFrame as error:
        return str(error), None
    return (found.number, found.time, found.markers.tobytes(),
            found.points.tobytes()), found.structure


def test_frames_are_read_as_by_qualisys_package():
    random, last = np.random.default_rng(1), None
    for _ in range(300):
        packet = drawn_packet(random)
        found = qtm_frame(packet, last)
        last = found.structure
        markers, points = read_by_qtm_rt(packet)
        np.testing.assert_array_equal(found.markers, .001 * markers)
        np.testing.assert_array_equal(found.points, .001 * points)
        assert (found.time, found.number) == struct.unpack_from('<qI', packet, 8)


def test_frames_are_the_same_by_the_structure_of_the_last():
    random, last, reused, refused = np.random.default_rng(5), None, 0, 0
    for _ in range(3000):
        packet = bytearray(drawn_packet(random))
        if random.random() < .3:
            for _ in range(random.integers(1, 4)):
                packet[random.integers(8, len(packet))] = random.integers(256)
            if random.random() < .2:
                del packet[random.integers(8, len(packet)):]
        expected, _ = result(bytes(packet))
        found, structure = result(bytes(packet), last)
        assert found == expected
        refused += structure is None
        reused += structure is not None and structure is last
        last = structure or last
    assert reused > 400 and refused > 100


@pytest.mark.parametrize('packet, said', [
    (struct.pack('<II', 8, QTM_DATA), 'of 8 bytes; expected at least 24'),
    (struct.pack('<IIqIIII', 32, QTM_DATA, 1, 1, 2**32 - 1, 0, 1), 'components with its size'),
    (struct.pack('<IIqIIII', 32, QTM_DATA, 1, 1, 1, 8, COMPONENTS['3d']), 'component 1 of 0 bytes'),
    (struct.pack('<IIqIIIIIhh', 40, QTM_DATA, 1, 1, 1, 16, COMPONENTS['3dres'], 2**32 - 1, 0, 0),
     '4294967295 markers of 16')])
def test_frames_of_sizes_that_lead_nowhere_are_refused(packet, said):
    with pytest.raises(MalformedFrame, match=said):
        qtm_frame(packet)
