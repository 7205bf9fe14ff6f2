"""Cut MCAP files: refused, or read as far as they go; each kind of compression."""

import re

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from hand_tracker.files.bags import (
    TYPE_STORE,
    BagError,
    bag_message,
    joint_state_message,
    marker_array_message,
    open_bag,
)

NEEDS = 'mcap',

FIRST_MESSAGE_NS = 1_700_000_000_000_000_000
# Those of lz4 are read whole alone.
CHUNK_BYTES = {CompressionType.LZ4: 50_000, CompressionType.ZSTD: 300_000,
               CompressionType.NONE: 300_000}


def write(path, compression, count):
    """Write messages of two topics; return them."""
    messages, channels = [], {}
    writer = Writer(str(path), compression=compression, chunk_size=CHUNK_BYTES[compression])
    writer.start('ros2')
    for frame in range(count):
        time = FIRST_MESSAGE_NS + 8_333_333 * frame
        messages += [
            bag_message('/markers', time, marker_array_message(
                time, 'mocap', 'abc', np.arange(9.).reshape(3, 3) + frame)),
            bag_message('/truth', time, joint_state_message(time, 'xy', (.1 * frame, -.1)))]
    for one in messages:
        if one.topic not in channels:
            text, _ = TYPE_STORE.generate_msgdef(one.type)
            channels[one.topic] = writer.register_channel(
                one.topic, 'cdr', writer.register_schema(one.type, 'ros2msg', text.encode()))
        writer.add_message(channels[one.topic], one.time, one.data, one.time)
    writer.finish()
    return messages


@pytest.mark.parametrize('compression', CompressionType)
def test_a_cut_file_is_read_as_far_as_it_goes_where_that_is_asked_for(tmp_path, compression):
    path = tmp_path / 'bag.mcap'
    messages = write(path, compression, 1000)
    data, counts = path.read_bytes(), []
    for length in np.linspace(10, len(data) - 1, 40).astype(int):
        path.write_bytes(data[:length])
        with pytest.raises(BagError, match=re.escape(str(path)) + ': .+--partial'):
            with open_bag(path):
                pass
        found = []
        try:
            with open_bag(path, partial=True) as bag:
                found = list(bag.messages())
                assert bag.notes == (f'cut: {len(found)} whole messages are read',)
                assert sum(bag.counts.values()) == len(found)
        except BagError as error:
            assert 'without whole messages' in str(error) or length < 50
        assert found == messages[:len(found)]
        counts.append(len(found))
    assert counts == sorted(counts) and counts[-1] == len(messages) and len(set(counts)) > 5


def test_a_whole_file_is_read_alike(tmp_path):
    messages = write(tmp_path / 'bag.mcap', CompressionType.ZSTD, 20)
    with open_bag(tmp_path / 'bag.mcap', partial=True) as bag:
        assert not bag.notes and list(bag.messages()) == messages


def test_a_damaged_chunk_ends_what_is_whole(tmp_path):
    path = tmp_path / 'bag.mcap'
    write(path, CompressionType.LZ4, 1000)
    data = bytearray(path.read_bytes())
    at = len(data) // 2
    data[at:at + 200] = bytes(200)
    path.write_bytes(data[:at + 300])
    with open_bag(path, partial=True) as bag:
        assert list(bag.messages())
