"""Run nodes: declare their parameters, spin them until interrupted, shut down."""

from __future__ import annotations

import faulthandler
import gc
import os
import re
import shlex
import signal
import sys
from ast import literal_eval
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from itertools import takewhile
from queue import SimpleQueue
from threading import Event, Thread, main_thread
from typing import Any

import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..messages.builders import Names, prefixed_names
from .executors import fastest_executor, steady_clock
from .parameters import Parameter
from .tracker_parameters import AUTO

POLL = .1  # [s]
NAMESAKE_PERIOD = 2.  # [s] between the looks for a node of the same name
NAMESAKE_LOOKS = 3
NODE_PARAMETER = re.compile(r'(\w+):(?!=).*:=')     # -p NODE:PARAMETER:=VALUE
SECTION_LIKENESS = .7  # of a section's name from which on it counts as misspelled
END_TIMEOUT = 30.  # [s] after which a process that hangs while it ends is ended
INTERRUPTS = signal.SIGINT, signal.SIGTERM


class InvalidArguments(HandTrackerError):
    """ROS cannot make sense of the command line."""


def declare(node: Node, table: Iterable[Parameter]) -> dict[str, Any]:
    """Declare parameters with their descriptions and limits.

    A value that is not allowed is refused with the reason, at the start and at run time.

    Parameters
    ----------
    node : rclpy.node.Node
    table : iterable of Parameter

    Returns
    -------
    dict of str to object
        Value of each parameter.

    Raises
    ------
    rclpy.exceptions.ParameterException
        If a value given at the start is not allowed or has the wrong type.
    """
    table = tuple(table)
    choices = {row.name: row.choices for row in table if row.choices}

    def check_choices(changes: list[Any]) -> SetParametersResult:
        reasons = [f"{change.name}: '{change.value}' is not one of "
                   f"{', '.join(choices[change.name])}" for change in changes
                   if change.value not in choices.get(change.name, (change.value,))]
        return SetParametersResult(successful=not reasons, reason='; '.join(reasons))

    if choices:
        node.add_on_set_parameters_callback(check_choices)
    given = _given_at_start(node)
    for row in table:
        if row.short_name in given:
            given.setdefault(row.name, given.pop(row.short_name))
    return {row.name: node.declare_parameter(row.name, row.default, _descriptor(row)).value
            for row in table}


def _given_at_start(node: Node) -> dict[str, Any]:
    """Return rclpy's parameters given at the start by name, which it lists nowhere else."""
    return getattr(node, '_parameter_overrides', {})


def _descriptor(row: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        name=row.name, description=row.description, read_only=row.read_only,
        dynamic_typing=row.any_type)
    if row.choices:
        descriptor.additional_constraints = f"one of {', '.join(row.choices)}"
    if row.range:
        lowest, highest = row.range
        if isinstance(row.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(lowest), to_value=float(highest))]
        else:
            descriptor.integer_range = [IntegerRange(from_value=lowest, to_value=highest)]
    return descriptor


def names_of(hand: Hand, prefix: str, wrist_frame: str, on_body: bool = False) -> Names:
    """Return the names of a hand's messages for parameters of which each may be `AUTO`.

    Parameters
    ----------
    hand : Hand
    prefix, wrist_frame : str
    on_body : bool, optional
        Whether the wrist hangs on a body.

    Returns
    -------
    Names
    """
    return prefixed_names(f'{hand.side}_' if prefix == AUTO else prefix,
                          None if wrist_frame == AUTO else wrist_frame, on_body)


def qos_of(values: Mapping[str, Any], topic: str) -> QoSProfile:
    """Return the quality of service that the parameters `qos.TOPIC.*` ask for.

    Parameters
    ----------
    values : mapping of str to object
        Of the parameters by name.
    topic : str
    """
    return QoSProfile(
        depth=values[f'qos.{topic}.depth'],
        reliability=ReliabilityPolicy[values[f'qos.{topic}.reliability'].upper()])


def log_line(node: Node, is_warning: bool, text: str) -> None:
    """Log a line as a warning or as information."""
    # rclpy wants each severity to be logged from a line of its own.
    if is_warning:
        node.get_logger().warning(text)
    else:
        node.get_logger().info(text)


def spin(*nodes: Node) -> None:
    """Serve nodes' callbacks until it is interrupted, with the fastest executor there is.

    Parameters
    ----------
    *nodes : rclpy.node.Node
    """
    interrupts = []
    with fastest_executor(*nodes) as executor:
        # An exception that a signal raises inside EventsExecutor comes out as another one.
        def interrupted(*interrupt: Any) -> None:
            interrupts.append(interrupt)
            _end_in_time()

        _handle_interrupts(interrupted)
        # What has been made stays: else a collection among the frames would go through all of it.
        gc.collect()
        gc.freeze()
        # Not spin(): EventsExecutor's overflows its wait in some releases.
        while rclpy.ok() and not interrupts:
            executor.spin_once(POLL)


@contextmanager
def spinning(*nodes: Node) -> Iterator[None]:
    """Serve nodes' callbacks in a thread of their own, beside the main thread.

    What a callback raises interrupts the main thread, and is raised there in its place.
    """
    ended = Event()
    faults: list[Exception] = []
    main = main_thread().ident
    assert main is not None

    def serve() -> None:
        try:
            while rclpy.ok() and not ended.is_set():
                executor.spin_once(POLL)
        except ExternalShutdownException:
            pass
        except Exception as fault:
            faults.append(fault)
            # Unlike interrupt_main, this also ends a wait.
            signal.pthread_kill(main, signal.SIGINT)

    with fastest_executor(*nodes) as executor:
        thread = Thread(target=serve, daemon=True)
        try:
            thread.start()
            try:
                yield
            finally:
                ended.set()
                thread.join()
        except KeyboardInterrupt:
            if not faults:
                raise
        if faults:
            raise faults[0] from None


def work_in_thread(work: Callable[[], object], stop: Callable[[], object]) -> None:
    """Let a thread work while the main one waits, and tell it to stop when that is interrupted.

    An interrupt may be raised where the main thread has just taken a lock, which would stay
    taken: what shares locks with other threads works in one that no signal interrupts.

    Parameters
    ----------
    work : callable
        What it raises is raised here.
    stop : callable
        Makes `work` end.
    """
    ended: SimpleQueue[BaseException | None] = SimpleQueue()

    def attempt() -> None:
        fault = None
        try:
            work()
        except BaseException as error:
            fault = error
        # Twice, as an interrupt may take the main thread away from what it has just got.
        ended.put(fault)
        ended.put(fault)

    Thread(target=attempt, daemon=True).start()
    try:
        fault = ended.get()
    except BaseException:
        stop()
        ended.get()
        raise
    if fault:
        raise fault


def run(make_node: Callable[[], Node], work: Callable[[Any], object] = spin,
        args: list[str] | None = None, name: str = 'hand_tracker',
        ros_words_alone: bool = True) -> int:
    """Make a node, let it work, end cleanly; the `main` of every node.

    Parameters
    ----------
    make_node : callable
        Returns the node.
    work : callable
        Called with the node; it ends with this.
    args : list of str, optional
        Command line; that of the process when not given.
    name : str
        Of the logger before there is a node.
    ros_words_alone : bool, optional
        Whether to refuse words of the command line that ROS does not know: the node has no others.

    Returns
    -------
    int
        Exit code: 0 at the end of the work or when interrupted by SIGINT or SIGTERM, 1 after
        an error that the work raises, as of the user's input, which is logged in one line.
    """
    return run_together({name: make_node}, work, args, ros_words_alone)


def run_together(makers: Mapping[str, Callable[[], Node]], work: Callable[..., object] = spin,
                 args: list[str] | None = None, ros_words_alone: bool = True) -> int:
    """Make nodes in one process, let them work, end cleanly, as `run`.

    Parameters
    ----------
    makers : mapping of str to callable
        Each returns a node; by the names of their loggers before they are there.
    work : callable
        Called with the nodes.
    args, ros_words_alone
        See `run`.
    """
    # rclpy's own handlers end the context from another thread, in the middle of a publish.
    _handle_interrupts(_leave)
    nodes: list[Node] = []
    try:
        _init(args)
        if ros_words_alone:
            _refuse_words(sys.argv[1:] if args is None else args)
        for make_node in makers.values():
            nodes.append(make_node())
        _handle_interrupts(_interrupt)
        _warn_of_unknown(nodes)
        _warn_of_absent(nodes, sys.argv if args is None else args)
        for node in nodes:
            _warn_of_namesake(node)
        work(*nodes)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (HandTrackerError, ParameterException) as error:
        is_made = len(nodes) == len(makers)
        logger = (nodes[-1].get_logger() if is_made else
                  rclpy.logging.get_logger([*makers][len(nodes)]))
        logger.error(_in_words(error))
        return 1
    except RuntimeError:  # RCLError has no public name
        # Where the context ends in the middle of a callback, its publish fails.
        if rclpy.ok():
            raise
    finally:
        # Python's end would leave a handler of its own to the system, which kills the process.
        _handle_interrupts(signal.SIG_IGN)
        _end_in_time()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
    return 0


def _in_words(error: Exception) -> str:
    """Return an error as a line; around a parameter's reason rclpy puts its name and a frame."""
    reason = re.sub(r'^Invalid parameter value .* for parameter\. Reason: ', '', str(error))
    return re.sub(r'^(.*\b([\w.]+)\b.*): \2$', r'\1', reason)


def _init(args: list[str] | None) -> None:
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # RCLError has no public name
        # Words between --ros-args and a flag are all that it says.
        if re.match(r"""\[['"]""", str(error)):
            raise _foreign_words(literal_eval(str(error))) from None
        places_in_rcl = r', at \S+:\d+'
        raise InvalidArguments(re.sub(places_in_rcl, '', ' '.join(str(error).split()))) from None


def _refuse_words(args: list[str]) -> None:
    # ROS takes NAME:=VALUE without -p, as for a launch file, for another name of a topic.
    assigned = [word for word in takewhile(lambda word: word != '--ros-args', args) if ':=' in word]
    words = remove_ros_args(args) + assigned
    if words:
        raise _foreign_words(words)


def _foreign_words(words: Sequence[str]) -> InvalidArguments:
    """Return the error of words that ROS does not take."""
    example = next((word for word in words if ':=' in word), 'NAME:=VALUE')
    return InvalidArguments(f"'{shlex.join(words)}': no arguments of ROS; expected parameters as "
                            f'--ros-args -p {example}, other names of topics as -r OLD:=NEW')


def refuse_unknown(node: Node, sections: Sequence[str]) -> None:
    """Refuse parameters that were given at the start, and that sections of a node do not have.

    Parameters
    ----------
    node : rclpy.node.Node
        With all its parameters declared.
    sections : sequence of str
        Such as 'safety', of 'safety.max_speed'.

    Raises
    ------
    InvalidArguments
        Of one in such a section, or in one whose name is misspelled.
    """
    known = node.get_parameters_by_prefix('')
    for name in _given_at_start(node):
        section, has_section, _ = name.partition('.')
        if name not in known and has_section and get_close_matches(
                section, sections, 1, SECTION_LIKENESS):
            meant = ''.join(f"; did you mean '{one}'?" for one in get_close_matches(name, known, 1))
            raise InvalidArguments(f"there is no parameter '{name}'{meant}")


def _warn_of_unknown(nodes: Sequence[Node]) -> None:
    """Log the parameters given at the start that no node has: rclpy drops them."""
    known = {name for node in nodes for name in node.get_parameters_by_prefix('')}
    given = {name: node for node in nodes for name in _given_at_start(node)}
    for node in nodes:
        unknown = [name for name, of_node in given.items()
                   if of_node is node and name not in known]
        alike = {name: sorted(one for one in known if one.endswith(f'.{name}'))
                 or get_close_matches(name, known, 1) for name in unknown}
        for name in filter(alike.get, unknown):
            meant = "' or '".join(alike[name])
            node.get_logger().warning(f"there is no parameter '{name}': left out; "
                                      f"did you mean '{meant}'?")
        # A file's section for every node may have many.
        if others := [f"'{name}'" for name in unknown if not alike[name]]:
            node.get_logger().warning(
                f"there {'are no parameters' if others[1:] else 'is no parameter'} "
                f"{', '.join(others)}: left out")


def _warn_of_absent(nodes: Sequence[Node], words: Sequence[str]) -> None:
    """Log the parameters of a command line that are for a node which is not in this process."""
    here = [node.get_name() for node in nodes]
    for flag, word in zip(words, words[1:]):
        addressed = NODE_PARAMETER.match(word) if flag in ('-p', '--param') else None
        if addressed and addressed[1] not in here:
            nodes[0].get_logger().warning(
                f"{word}: left out, as no node is called '{addressed[1]}' here; expected "
                f'{", ".join(here)}')


def namesake_fault(node: Node) -> str:
    """Return what is wrong where another node has this one's name; '' where none has.

    Parameters
    ----------
    node : rclpy.node.Node
    """
    own = node.get_name(), node.get_namespace()
    if node.get_node_names_and_namespaces().count(own) < 2:
        return ''
    return (f'another node is named {node.get_fully_qualified_name()} too, and both publish and '
            'answer (one that was killed counts for 20 s): end one, or give it another name '
            '(--ros-args -r __node:=NAME) and other topics')


def _warn_of_namesake(node: Node) -> None:
    """Log, soon after the start, that another node has this one's name."""
    looks = 0

    def look() -> None:
        nonlocal looks
        looks += 1
        fault = namesake_fault(node)
        if fault:
            node.get_logger().warning(fault)
        if fault or looks == NAMESAKE_LOOKS:
            timer.cancel()

    timer = node.create_timer(NAMESAKE_PERIOD, look, clock=steady_clock())


def _leave(number: int, frame: Any) -> None:
    # An exception in the middle of a compilation breaks it, and nothing is to be ended yet.
    os._exit(0)


def _interrupt(number: int, frame: Any) -> None:
    # A second Ctrl-C must not cut the way out short.
    _handle_interrupts(signal.SIG_IGN)
    _end_in_time()
    raise KeyboardInterrupt


def _end_in_time() -> None:
    """End the process after `END_TIMEOUT`, with a traceback, unless that is cancelled before."""
    # Its thread needs no GIL, which the middleware and Python may both wait for.
    with suppress(OSError, AttributeError, RuntimeError):  # no standard error to write to
        faulthandler.dump_traceback_later(END_TIMEOUT, exit=True)


def _handle_interrupts(handler: Any) -> None:
    for number in INTERRUPTS:
        signal.signal(number, handler)
