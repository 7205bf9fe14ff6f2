"""Plan of a launch by its arguments and its parameter file; contradictions are refused."""

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from ..adapters.marker_messages import (
    DEFAULT_MESSAGE,
    MESSAGES_OF,
    NAMED_POSE_MESSAGE,
    SERVED,
    DirectInput,
    direct_input,
)
from ..adapters.point_frame import UPRIGHT
from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH, SIDES, Hand
from ..files.keystore import security_environment
from ..files.parameter_file import ParameterFile
from ..nodes.tracker_parameters import (
    AUTO,
    SEPARATE,
    START,
    start_of_hand,
    starting_hand,
    values_of_hand,
    with_defaults,
)
from ..package_data import PACKAGE_NAME

Value = TypeVar('Value')

# Systems of which the tracker, or else a source node, takes the messages or packets.
SYSTEMS = 'point_cloud', 'mocap4r2', *SERVED, 'landmarks'
# Sources that an argument says something to.
SOURCES_OF_ARGUMENT = {
    'topic': tuple(MESSAGES_OF), 'message': tuple(MESSAGES_OF), 'server': SERVED,
    'subject': SYSTEMS, 'up': SYSTEMS, 'latency': ('qualisys',), 'recording': ('recording',)}
NO_PREFIX = 'none'  # as `ros2 launch` takes no empty value
TRACKER_NAME, SOURCE_NAME, RETARGET_NAME = 'hand_tracker', 'source', 'retarget'
MARKERS_TOPIC = 'markers'
# Parameters of the tracker that the URDF depends on, and the arguments that set them too.
ARGUMENT_OF = {
    'hand_file': 'hand', 'layout': 'layout', 'side': 'side', 'limits.preset': 'limits',
    'coupling.preset': 'coupling', 'thumb': 'thumb', 'prefix': 'prefix', 'hand_length': None,
    'hand_breadth': None}
# Arguments of the left one of both hands, and what they are for one hand.
LEFT_ARGUMENTS = {
    'left_hand': 'hand is the hand file', 'left_robot': 'robot is the robot',
    'left_body_frame': 'body_frame is the frame', 'left_mount': 'mount is the file',
    'left_robot_description': "robot_description is the robot's"}
ROBOT_TAKES = 'hand_file', 'hand_length', 'hand_breadth', 'limits.preset', 'thumb', 'prefix'
MOUNT_TAKES = 'hand_file', 'side', 'prefix'
SOURCE_TAKES = 'layout', 'hand_file'
SKIN_TAKES = 'hand_file', 'side', 'hand_length', 'hand_breadth', 'thumb', 'prefix'


class InvalidLaunch(HandTrackerError, ValueError):
    """An argument of a launch does not fit the others, the parameter file or what is installed."""


class LaunchedHand(NamedTuple):
    """A hand of a launch.

    Attributes
    ----------
    hand : Hand
    prefix : str
        Of its names.
    namespace : str
        Of what is its alone; empty but for both hands.
    parameters : dict of str to object
        Of the tracker, for this hand.
    """

    hand: Hand
    prefix: str
    namespace: str
    parameters: dict[str, Any]


class LaunchPlan:
    """Hands, sources and robots of one launch, checked.

    Parameters
    ----------
    given : mapping of str to str
        Value of each argument, and `ros_namespace` where a launch file has pushed one.
    is_installed : callable
        Whether there is a package of this name.

    Attributes
    ----------
    given
    publishes_links : bool
        Whether robot_state_publisher is there, to broadcast the frames of the links.
    broadcast : {'wrist', 'all'}
        Parameter of the tracker: all without robot_state_publisher.
    in_file : dict of str to object
        Parameters of the tracker in the parameter file.
    hand_parameters : dict of str to object
        Those of the tracker that the URDF depends on.
    hands : list of LaunchedHand
        The right one of both first.
    common : dict of str to object
        Parameters of every node.
    environment : dict of str to str
        Variables of every node under SROS 2; empty without.
    direct : DirectInput or None
        How the tracker takes a source's messages itself; None with a source node.
    mounts : list of (str, str)
        Frame of the body that each hand hangs on, and file of its offset; both empty for none.
    on_body : bool
        Whether the hands hang on a body.
    robots : list of dict
        Parameters of the node by which each hand drives its robot.
    should_show_robots, shows_robots : bool
        Whether robots are to be shown, and whether something can broadcast their frames.
    has_robot, has_source : bool
        Whether the tracker's process drives the robot too, and receives a system's packets.

    Raises
    ------
    HandTrackerError
        Naming the argument or parameter, its value and what is expected.
    """

    def __init__(self, given: Mapping[str, str], is_installed: Callable[[str], bool]) -> None:
        self.given = given
        if given['rviz'] == 'true' and not is_installed('rviz2'):
            # Found out later, nodes that have been started are left behind.
            raise InvalidLaunch('rviz: rviz2 is not installed')
        self.publishes_links = is_installed('robot_state_publisher')
        self.broadcast = 'wrist' if self.publishes_links else 'all'
        self._file = self._parameter_file()
        self.in_file = self._parameters_in_file(TRACKER_NAME)
        self.hand_parameters = self._shared_parameters()
        for name, sources in SOURCES_OF_ARGUMENT.items():
            self._require_source(name, sources)
        if given['up'] not in ('', *UPRIGHT):
            raise InvalidLaunch(f"up: '{given['up']}'; expected {' or '.join(UPRIGHT)}")
        self.direct = self._direct_source()
        self.hands = self._both_hands() if self.hand_parameters['side'] == BOTH else [
            self._one_hand()]
        self._check_frames(f'{self.hands[0].prefix}wrist')
        self.common = {'use_sim_time': self.agreed(
            'use_sim_time', given['use_sim_time'] == 'true', False)}
        is_secure = given['use_security'] == 'true'
        if given['keystore'] and not is_secure:
            raise InvalidLaunch(f"keystore: '{given['keystore']}'; expected with "
                                'use_security:=true, without which everything is open')
        self.environment = security_environment(given['keystore']) if is_secure else {}
        self.mounts = self._mounts()
        self.on_body = self.agreed('on_body', any(map(any, self.mounts)), False)
        self.shows_robots = (self.is_on('show_robot') and self.publishes_links
                             and is_installed('tf2_ros'))
        self.robots = [self._robot_parameters(hand) for hand in self.hands]
        self.should_show_robots = self.is_on('show_robot') and any(
            robot['robot'] for robot in self.robots)
        self.has_robot = self._drives_robot_in_tracker()
        self.has_source = self._takes_packets_in_tracker()
        self._require_sections()

    def _require_source(self, name: str, sources: Sequence[str]) -> None:
        """Refuse an argument that says nothing to the source."""
        value = self.given.get(name)
        if value and self.given['source'] not in sources:
            instead = '; the topic of MarkerArrays is markers:=' if name == 'topic' else ''
            raise InvalidLaunch(f"{name}: '{value}'; expected for source:={', '.join(sources)} "
                                f'only{instead}')

    def is_on(self, name: str) -> bool:
        """Return whether something is shown: by its argument, or with RViz when that is auto."""
        return self.given[name] == 'true' or (
            self.given[name] == AUTO and self.given['rviz'] == 'true')

    def number(self, name: str) -> float:
        """Return the value of an argument that is a number."""
        try:
            return float(self.given[name])
        except ValueError:
            raise InvalidLaunch(f"{name}: '{self.given[name]}'; expected a number") from None

    def full_name(self, *parts: str) -> str:
        """Return the name of a node or topic with the namespaces before it."""
        namespace = self.given['namespace']
        if not namespace.startswith('/'):
            # A launch file that includes this one may have pushed another before it.
            namespace = f"{self.given.get('ros_namespace', '')}/{namespace}"
        return '/'.join(('', *filter(None, namespace.split('/')), *filter(None, parts)))

    def agreed(self, name: str, value: Value, default: Value, argument: str = '',
               in_file: Mapping[str, Any] | None = None) -> Value:
        """Return a value from the parameter file, where its argument was left at the default.

        `in_file` has the parameters of the node in the file, where that is not the tracker.
        """
        in_file = self.in_file if in_file is None else in_file
        if name not in in_file:
            return value
        found = in_file[name]
        if not isinstance(found, type(default)):
            raise InvalidLaunch(f'parameters: {name}: {found!r}; expected a value like {default!r}')
        if value not in (default, found):
            raise InvalidLaunch(
                f'parameters: {name}: {found!r}, but by the argument '
                f'{argument or ARGUMENT_OF.get(name, name)} it is {value!r}; leave out one of them')
        return found

    @property
    def respawns_tracker(self) -> bool:
        """Whether a tracker that dies starts anew: asked for, or as another process drives."""
        return self.given['respawn'] == 'true' or (
            self.given['respawn'] == AUTO and not self.has_robot
            and any(robot['robot'] for robot in self.robots))

    @property
    def wrist_frame(self) -> str:
        """Parameter of nodes that look the wrist up: its frame by the file."""
        return self.in_file.get('wrist_frame', AUTO)

    @property
    def source_parameters(self) -> dict[str, Any]:
        """Parameters of the source node that arguments set."""
        texts = ('source', 'topic', 'message', 'server', 'subject')
        return {**{name: self.given[name] for name in texts if self.given[name]},
                # In the YAML of parameters a plain y is true.
                **({'up': f'+{self.given["up"]}'} if self.given['up'] else {}),
                **({'latency': self.number('latency')} if self.given['latency'] else {})}

    @property
    def marker_topic(self) -> str:
        """Topic of the tracker's markers; drivers of mocap4r2 have their own /markers."""
        if self.direct:
            return self.direct.topic
        if self.given['source'] in SYSTEMS and self.given['markers'] == MARKERS_TOPIC:
            return f'{SOURCE_NAME}/markers'
        return self.given['markers']

    @property
    def tracker_parameters(self) -> dict[str, Any]:
        """Parameters of the tracker, and of what shares its process."""
        message = self.direct.message if self.direct else DEFAULT_MESSAGE
        return {
            **self.hand_parameters, 'broadcast': self.broadcast, 'on_body': self.on_body,
            'marker_message': self.agreed('marker_message', message, DEFAULT_MESSAGE),
            **({f'{hand.hand.side}.hand_file': hand.parameters['hand_file']
                for hand in self.hands} if len(self.hands) > 1 else {}),
            **(self.robots[0] if self.has_robot else {}),
            **(self.source_parameters if self.has_source else {})}

    @property
    def shown_robots(self) -> list[tuple[LaunchedHand, dict[str, Any]]]:
        """Each hand with the robot that is shown beside it."""
        return [(hand, robot) for hand, robot in zip(self.hands, self.robots)
                if self.shows_robots and robot['robot'] and robot['show_robot']]

    @property
    def own_source_parameters(self) -> dict[str, Any]:
        """Parameters of the source node in a process of its own."""
        hand = self.hands[0]
        return {**{name: hand.parameters[name] for name in SOURCE_TAKES},
                'side': BOTH if len(self.hands) > 1 else hand.hand.side, **self.source_parameters}

    def skin_parameters(self, hand: LaunchedHand) -> dict[str, Any]:
        """Return the parameters of the skin of a hand."""
        return {**{name: hand.parameters[name] for name in SKIN_TAKES},
                'wrist_frame': self.wrist_frame}

    def mount_parameters(self, hand: LaunchedHand, frame: str) -> dict[str, Any]:
        """Return the parameters of a hand's mount on a frame of a body, '' for the file's."""
        return {**{name: hand.parameters[name] for name in MOUNT_TAKES},
                'wrist_frame': self.wrist_frame,
                **({'body_frame': frame} if frame else {}),
                **({'mount_file': f'my_{hand.namespace}_mount.yaml'} if hand.namespace else {})}

    def joint_remappings(self, hand: LaunchedHand) -> list[tuple[str, str]]:
        """Return the remappings by which a node of one of both hands finds its joint states."""
        if not hand.namespace or self.in_file.get('joint_state_topics') == SEPARATE:
            return []
        return [(name, self.full_name(name)) for name in ('joint_states', 'joint_confidence')]

    def _parameter_file(self) -> ParameterFile | None:
        try:
            return ParameterFile(self.given['parameters']) if self.given['parameters'] else None
        except HandTrackerError as error:
            raise InvalidLaunch(f'parameters: {error}') from None

    def _parameters_in_file(self, *node: str, unlike: str = '') -> dict[str, Any]:
        """Return the parameters of a node in the parameter file, as `ParameterFile`."""
        if self._file is None:
            return {}
        return self._file.parameters(self.full_name(*node), unlike and self.full_name(unlike))

    def _require_sections(self) -> None:
        """Refuse a parameter file with nothing for the nodes here."""
        nodes = [(TRACKER_NAME,), *([(SOURCE_NAME,)] if self.given['source'] in SYSTEMS else []),
                 *((hand.namespace, RETARGET_NAME) for hand, robot in zip(self.hands, self.robots)
                   if robot['robot'])]
        try:
            if self._file is not None:
                self._file.require([self.full_name(*node) for node in nodes])
        except HandTrackerError as error:
            is_without_robot = f'for {RETARGET_NAME};' in str(error) and not any(
                robot['robot'] for robot in self.robots)
            raise InvalidLaunch(f'parameters: {error}' + (
                '; there is a retarget node with robot:= alone' if is_without_robot else '')
                ) from None

    def _shared_parameters(self) -> dict[str, Any]:
        """Return the parameters of the tracker that the URDF depends on."""
        defaults = {row.name: row.default for row in START}
        values: dict[str, Any] = {}
        for name, argument in ARGUMENT_OF.items():
            value = self.given[argument] if argument else defaults[name]
            if argument == 'prefix' and value == NO_PREFIX:
                value = ''
            values[name] = self.agreed(name, value, defaults[name])
        return values

    def _one_hand(self) -> LaunchedHand:
        for name, instead in LEFT_ARGUMENTS.items():
            if self.given[name]:
                raise InvalidLaunch(f"{name}: '{self.given[name]}'; expected none but for "
                                    f'side:=both: {instead}')
        values = self.hand_parameters
        hand, _ = starting_hand(with_defaults(values))
        prefix = values['prefix']
        return LaunchedHand(hand, f'{hand.side}_' if prefix == AUTO else prefix, '', values)

    def _both_hands(self) -> list[LaunchedHand]:
        has_names = self.direct is not None and self.direct.message == NAMED_POSE_MESSAGE
        for name, is_of_one in (
                ('source', self.given['source'] == 'landmarks' and not has_names),
                ('subject', bool(self.given['subject']))):
            if is_of_one:
                raise InvalidLaunch(f"{name}: '{self.given[name]}'; expected another or none for "
                                    'side:=both: it is of one hand')
        files = {f'{side}.hand_file': self.agreed(
            f'{side}.hand_file', self.given['left_hand'] if side == 'left' else '', '')
            for side in SIDES}
        own = {row.name: row.default for side in SIDES for row in start_of_hand(side)}
        hands = []
        for side in SIDES:
            values = values_of_hand(with_defaults({**own, **self.hand_parameters, **files}), side)
            hand, _ = starting_hand(values)
            hands.append(LaunchedHand(hand, f'{side}_', side, values))
        return hands

    def _check_frames(self, root: str) -> None:
        """Refuse a parameter file by which the tree of TF would fall apart."""
        found = self.in_file.get('broadcast', self.broadcast)
        if found != self.broadcast:
            raise InvalidLaunch(
                f"parameters: broadcast: '{found}'; here it is '{self.broadcast}', as "
                f"robot_state_publisher is {'' if self.publishes_links else 'not '}installed")
        if self.publishes_links and self.wrist_frame not in (AUTO, root):
            raise InvalidLaunch(f"parameters: wrist_frame: '{self.wrist_frame}'; for "
                                f"robot_state_publisher it is '{root}'")

    def _direct_source(self) -> DirectInput | None:
        if self.given['source'] not in SYSTEMS or self.given['markers'] != MARKERS_TOPIC:
            return None
        return direct_input({**self._parameters_in_file(SOURCE_NAME), **self.source_parameters})

    def _mounts(self) -> list[tuple[str, str]]:
        mounts = []
        for hand in self.hands:
            which = 'left_' if hand.namespace == 'left' else ''
            file = self.given[f'{which}mount']
            if file and not Path(file).is_file():
                raise InvalidLaunch(f"{which}mount: '{file}'; expected a parameter file, as "
                                    '~/calibrate of the mount node writes')
            mounts.append((self.given[f'{which}body_frame'], file))
        if any(map(any, mounts)) and not all(map(any, mounts)):
            raise InvalidLaunch('body_frame, mount, left_body_frame, left_mount: of one hand '
                                'alone; expected that both hang on a body, or neither')
        return mounts

    def _robot_parameters(self, hand: LaunchedHand) -> dict[str, Any]:
        """Return the parameters of the node by which a hand drives its robot."""
        arguments = {'robot': 'robot', 'robot_description': 'robot_description'}
        if hand.namespace == 'left':
            # A robot file has the URDF of either side; a URDF is of one.
            arguments = {'robot': 'left_robot' if self.given['left_robot'] else 'robot',
                         'robot_description': 'left_robot_description'}
        in_file = self._parameters_in_file(hand.namespace, RETARGET_NAME)
        robot = {name: self.agreed(name, self.given[argument], '', argument, in_file)
                 for name, argument in arguments.items()}
        person = {**{name: hand.parameters[name] for name in ROBOT_TAKES}, 'side': hand.hand.side,
                  'wrist_frame': self.wrist_frame, 'on_body': self.on_body}
        shown = self.shows_robots
        if outputs := self.agreed('outputs', self.given['outputs'], '', in_file=in_file):
            robot['outputs'] = outputs
        urdf = arguments['robot_description']
        if self.given[urdf] and not robot['robot']:
            raise InvalidLaunch(f"{urdf}: '{self.given[urdf]}'; expected with {arguments['robot']}"
                                ':=, a preset or a robot file, or the URDF itself')
        if robot['robot']:
            self._check_alike(hand.namespace, {**person, **self.common})
            shown = self.agreed(
                'show_robot', shown, self.given['show_robot'] == AUTO and shown, in_file=in_file)
        return {**person, **robot, 'show_robot': shown}

    def _check_alike(self, namespace: str, values: Mapping[str, Any]) -> None:
        """Refuse a section for a retarget node by which it would differ from the tracker."""
        # What a section says to the tracker too was judged there.
        found = self._parameters_in_file(namespace, RETARGET_NAME, unlike=TRACKER_NAME)
        for name, value in values.items():
            if found.get(name, value) != value:
                raise InvalidLaunch(
                    f'parameters: {name}: {found[name]!r} for '
                    f'{self.full_name(namespace, RETARGET_NAME)}; expected {value!r}, as the '
                    'tracker has it')

    def _drives_robot_in_tracker(self) -> bool:
        """Return whether the tracker's process drives the robot too; refuse it where it cannot."""
        shared = self.given['robot_process'] == 'tracker' and any(
            robot['robot'] for robot in self.robots)
        for alone, what, why in (
                (self.given['lifecycle'] == 'true', 'lifecycle:=true',
                 'that process is not managed'),
                (len(self.hands) > 1, 'side:=both', 'it drives one robot')):
            if shared and alone:
                raise InvalidLaunch(f"robot_process: 'tracker'; expected own with {what}: {why}")
        return shared

    def _takes_packets_in_tracker(self) -> bool:
        """Return whether the tracker's process is a system's client; refuse it where it cannot."""
        process = self.given['source_process']
        alone = [f'{name}:=true' for name in ('lifecycle', 'use_security')
                 if self.given[name] == 'true']
        if process == 'tracker' and alone:
            raise InvalidLaunch(f"source_process: 'tracker'; expected own with {alone[0]}")
        return self.given['source'] in SERVED and process != 'own' and not alone


def names_launch_file(words: Sequence[str], file: Path) -> bool:
    """Return whether a command line starts a launch file of this package, not one that includes it.

    Parameters
    ----------
    words : sequence of str
        Of the command line: the package and the file's name, or the file's path.
    file : Path
        Of the launch file.

    Returns
    -------
    bool
    """
    return (PACKAGE_NAME, file.name) in zip(words, words[1:]) or file.resolve() in [
        Path(word).resolve() for word in words]


def refuse_unknown_arguments(words: Sequence[str], known: Sequence[str]) -> None:
    """Refuse unknown arguments of a command line, which launch drops without a word.

    Parameters
    ----------
    words : sequence of str
        Of the command line, arguments as 'name:=value'.
    known : sequence of str
        Names of arguments.

    Raises
    ------
    InvalidLaunch
        Naming the argument, and the one that is most like it.
    """
    given = [word.partition(':=')[0] for word in words if ':=' in word]
    parameters = {word for row in START for word in (row.name, row.short_name)}
    for name in given:
        is_parameter = name in parameters
        if name not in known and (is_parameter or name.isidentifier()):
            alike = get_close_matches(name, known, 1)
            raise InvalidLaunch(
                f"there is no argument '{name}'"
                + (', but a parameter of the tracker for a file (parameters:=FILE)' if is_parameter
                   else f", did you mean '{alike[0]}'?" if alike else '')
                + f'; expected are {", ".join(known)}')
