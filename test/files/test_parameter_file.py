"""Which parameters a node takes from a parameter file."""

import pytest

from hand_tracker.files.parameter_file import InvalidParameterFile, ParameterFile, save_parameters

NODE = '/left/hand_tracker'


@pytest.fixture
def parameters(tmp_path):
    def read(text, node=NODE):
        (tmp_path / 'mine.yaml').write_text(text)
        file = ParameterFile(tmp_path / 'mine.yaml')
        file.require([node])
        return file.parameters(node)
    return read


@pytest.mark.parametrize('section', [
    '/**', '/left/hand_tracker', 'left/hand_tracker', '/left/*', '/*/hand_tracker',
    '/**/hand_tracker', '/left/**'])
def test_sections_that_are_for_a_node(parameters, section):
    assert parameters(f'{section}: {{ros__parameters: {{side: left}}}}') == {'side': 'left'}


def test_namespaces_and_parameters_may_be_nested(parameters):
    assert parameters('left: {hand_tracker: {ros__parameters: {limits: {preset: wide}}}}') == {
        'limits.preset': 'wide'}


# As rclpy 7.1.6 has them of the same files.
def test_the_last_value_counts(parameters):
    assert parameters('''
/left/hand_tracker: {ros__parameters: {a: 1, b: 1}}
/**: {ros__parameters: {a: 2}}
/hand_tracker: {ros__parameters: {b: 3}}
''') == {'a': 2, 'b': 1}


@pytest.mark.parametrize(('text', 'said'), [
    ('', "for no node; expected '/\\*\\*' or '/left/hand_tracker', and 'ros__parameters'"),
    ('side: left', 'for no node'),
    ('hand_tracker: {ros__parameters: {side: left}}', 'for hand_tracker; expected'),
    ('/*: {ros__parameters: {side: left}}', 'for /\\*; expected'),
    ('{/**: {ros__parameters: {}}, hand_tracker: {ros__parameters: {side: left}}}',
     'for /\\*\\*, hand_tracker, of which none names the node /left/hand_tracker'),
    ('a: b: c', "a second ':' in an entry")])
def test_what_would_be_left_out_is_refused(parameters, text, said):
    with pytest.raises(InvalidParameterFile, match=f'mine.yaml(:1:5)?: {said}'):
        parameters(text)


def test_a_file_for_several_nodes_of_the_name(parameters):
    text = ('{/left/hand_tracker: {ros__parameters: {side: left}}, '
            'hand_tracker: {ros__parameters: {side: right}}}')
    assert parameters(text) == {'side': 'left'}
    assert parameters(text, '/hand_tracker') == {'side': 'right'}


def test_a_file_for_some_of_several_nodes(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('/right/retarget: {ros__parameters: {rate: 50.0}}')
    file, both = ParameterFile(path), ['/right/retarget', '/left/retarget']
    file.require(['/hand_tracker', *both])
    assert [file.parameters(node) for node in both] == [{'rate': 50.}, {}]
    with pytest.raises(InvalidParameterFile, match="expected '/\\*\\*' or '/hand_tracker', and"):
        file.require(['/hand_tracker'])
    path.write_text('{/**: {ros__parameters: {}}, retarget: {ros__parameters: {rate: 50.0}}}')
    with pytest.raises(InvalidParameterFile,
                       match='none names the node /right/retarget or /left/retarget; expected'):
        ParameterFile(path).require(['/hand_tracker', *both])


def test_what_a_file_sets_for_a_node_and_not_for_another(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text("""
/**: {ros__parameters: {a: 1, b: 1}}
/left/*: {ros__parameters: {b: 2}}
/left/retarget: {ros__parameters: {c: 3}}
""")
    file = ParameterFile(path)
    assert file.parameters('/left/retarget') == {'a': 1, 'b': 2, 'c': 3}
    assert file.parameters('/left/retarget', unlike='/hand_tracker') == {'b': 2, 'c': 3}
    assert file.parameters('/left/retarget', unlike=NODE) == {'c': 3}


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InvalidParameterFile, match='absent.yaml: No such file'):
        ParameterFile(tmp_path / 'absent.yaml')


def test_what_is_written_is_read_by_every_node(tmp_path):
    values = {'body_frame': 'hand', 'x': .25, 'qw': 1e-5, 'number': 3}
    save_parameters(tmp_path / 'mine.yaml', 'Where it rests.', values)
    assert ParameterFile(tmp_path / 'mine.yaml').parameters(NODE) == values
    assert (tmp_path / 'mine.yaml').read_text().startswith('# Where it rests.\n')
