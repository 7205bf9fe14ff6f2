"""Output files that cannot be written are named, not their temporary ones."""

import numpy as np
import pytest

from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.files.angle_table import TableError, write_angle_table
from hand_tracker.files.bags import (
    BagError,
    bag_message,
    marker_array_message,
    write_bag,
)
from hand_tracker.files.hand_file import save_hand
from hand_tracker.files.layout_file import save_layout
from hand_tracker.output_files import OutputError, folder_beside, require_writable

NO_DISK = '/proc'  # a folder in which nobody, root neither, can make a file


def table(path):
    write_angle_table(path, JOINTS, [(0., np.zeros(len(JOINTS)), ())])


def bag(path):
    write_bag(path, [bag_message('/m', 0, marker_array_message(0, 'm', ['a'], np.zeros((1, 3))))])


def hand(path):
    save_hand(path, Hand.scaled(), MarkerLayout())


def layout(path):
    save_layout(path, MarkerLayout())


@pytest.mark.parametrize(('write', 'name', 'refusal'), (
    (table, 'angles.csv', TableError), (bag, 'angles.mcap', BagError),
    (hand, 'hand.yaml', OutputError), (layout, 'layout.yaml', OutputError)))
def test_the_output_is_named_where_its_folder_takes_none(tmp_path, write, name, refusal):
    with pytest.raises(refusal, match=rf'^{NO_DISK}/{name}: cannot be written \(.+\); expected'):
        write(f'{NO_DISK}/{name}')
    (tmp_path / name).mkdir()
    with pytest.raises(refusal, match=rf'{name}: cannot be written'):
        write(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_the_folder_beside_is_gone_after_an_error(tmp_path):
    with pytest.raises(HandTrackerError, match='of the work'), \
            folder_beside(tmp_path / 'out', OutputError) as folder:
        (folder / 'part').touch()
        raise HandTrackerError('of the work')
    assert not list(tmp_path.iterdir())


def test_a_file_that_could_be_written_is_left_alone(tmp_path):
    (tmp_path / 'there').write_text('text')
    require_writable(tmp_path / 'there')
    require_writable(tmp_path / 'new')
    assert (tmp_path / 'there').read_text() == 'text' and not (tmp_path / 'new').exists()
    for path in (tmp_path, tmp_path / 'absent' / 'new'):
        with pytest.raises(OutputError, match=f'^{path}: cannot be written'):
            require_writable(path)
