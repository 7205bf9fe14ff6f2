"""Faults of a command line: one line, and the names that an unknown option is near to."""

import signal

import pytest

from hand_tracker.cli import calibrate, evaluate, plot, robot, simulate, track
from hand_tracker.cli.reporting import reporting


@pytest.mark.parametrize('main, arguments', [
    (calibrate.main, ('in.c3d', '-o', 'my.yaml')), (plot.main, ('in.c3d',)),
    (simulate.main, ('demo', '-o', 'out.mcap'))])
def test_both_sides_are_one_after_the_other_where_a_command_takes_one(main, arguments, capsys):
    with pytest.raises(SystemExit):
        main([*arguments, '--side', 'both'])
    said = capsys.readouterr().err
    assert 'both: this command takes one hand at a time; expected --side right, and' in said
    assert 'hand_tracker track takes both' in said
    assert said.count('\n') == 1


@pytest.mark.parametrize('main, arguments, said', [
    (track.main, ('in.c3d',), 'hand_tracker track: the following arguments are required: '
     '-o/--output (hand_tracker track --help)'),
    (track.main, ('in.c3d', '-o', 'a.csv', '--limit=wide'), 'hand_tracker track: unknown option '
     '--limit; is --limits meant? (hand_tracker track --help)'),
    (track.main, ('in.c3d', '--ouput', 'a.csv'), 'hand_tracker track: unknown option --ouput; '
     'is --output meant? (hand_tracker track --help)'),
    (track.main, ('in.c3d', '-o', 'a.csv', '--zzz'),
     'hand_tracker track: unknown option --zzz (hand_tracker track --help)'),
    (robot.main, ('inspect', 'allegro', '--picure', 'a.png'), 'hand_tracker robot inspect: unknown '
     'option --picure; is --picture meant? (hand_tracker robot inspect --help)'),
    (evaluate.main, ('noise', '--sed', '1'), 'hand_tracker evaluate: unknown option --sed; '
     'is --seed meant? (hand_tracker evaluate --help)')])
def test_a_wrong_command_line_is_told_in_one_line(main, arguments, said, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(list(arguments))
    assert stopped.value.code == 2
    assert capsys.readouterr().err == f'{said}\n'


@pytest.fixture
def handlers():
    """Put the handlers of signals back that a command has set."""
    before = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    yield
    for number, handler in before:
        signal.signal(number, handler)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_of_any_command_is_told_in_one_line(number, handlers, capsys):
    @reporting
    def main(arguments):
        signal.raise_signal(number)
        return 0

    assert main([]) == 130
    assert capsys.readouterr().err == ('hand_tracker test_reporting: interrupted; no unfinished '
                                       'file is left\n')
