"""What there is to say about the tracker's input: changes of state, and each cause once.

No ROS in here: the node tells what came and asks a few times a second what to log, so
that nothing is ever logged at the rate of the markers.
"""

import math

import numpy as np

from ..core.model.marker_layout import MARKERS, PALM_MARKERS
from ..core.model.states import MarkerState, PalmState
from .marker_events import Budget, MarkerNews
from .statistics import Fit

SILENT = 3.   # [s] without markers before that is said
NEVER = 5.    # [s] of tracking before a marker that was never seen is named
OFF = .015    # [m] that the seen markers may be off the hand on average
OFF_FOR = 2.  # [s] before more than that is said
# Fitted hands: 0 to 2.4 mm; 5 % too long or short: up to 3.3; markers on the skin: 5 to 8.
UNFIT = .005  # [m] that seen markers are off a hand which fits badly, on average over
FIT_FOR = 10.  # [s] of tracking, or in a recording that ends at least
FIT_LEAST = 2.  # [s]
STANDING = 10  # frames in a row with one stamp before that is said
CAUSES = 32   # distinct causes that are said at most

MARKER_ARRAY = 'visualization_msgs/msg/MarkerArray'
CHECK = ('check unit_scale (1 for metres, 0.001 for millimetres), the size of the hand and '
         'labels.*')
FAULTS = {
    PalmState.LOST: 'the palm is lost: none of its markers is seen',
    PalmState.COINCIDENT: 'palm markers coincide',
    PalmState.COLLINEAR: 'the palm markers lie on one line',
    PalmState.TOO_FAR_APART: f'the palm markers are too far apart for this hand: {CHECK}',
    PalmState.TOO_CLOSE: f'the palm markers are too close together for this hand: {CHECK}',
}


class Watch:
    """Watch the input of one tracker.

    Parameters
    ----------
    now : float
        Of a clock that never jumps, as in every method [s].
    topic : str
        Where the markers come from.
    labels : LabelMap
    """

    def __init__(self, now, topic, labels):
        self.labels = labels
        self._topic = topic
        self._received = self._labelled = self._since = now
        self._palm = self._frame = self._state = self._started = self._fault = None
        self._miss = 0.  # [m]
        self._off_since = None
        self._off_for = 0.
        self._announced = None
        self._has_tracked = False
        self._fit = Fit()
        self._stamp, self._standing = None, 0
        self._budget = Budget()
        self._markers = MarkerNews()
        self._causes = set()
        self._pending = []

    def received(self, now, frame):
        """Note what a message held.

        Parameters
        ----------
        now : float
        frame : MarkerFrame
        """
        self._received, self._frame = now, frame
        if frame.stamp is not None:
            self._labelled = now
            self._watch_time(frame.stamp.sec, frame.stamp.nanosec)
        for name in frame.foreign:
            self.once(('frame', name), f"markers in frame '{name}' are left out, as those of "
                      f"frame '{frame.frame_id}' are tracked (mocap_frame)")
        for slot in frame.doubled:
            marker = MARKERS[slot]
            self.once(('doubled', slot), 'several markers of one message answer to the label '
                      f"'{self.labels.labels[slot]}' of {marker}; the last one counts. "
                      f'A more precise labels.{marker} tells them apart')

    def passed(self, now, stamp):
        """Note that messages like the last one came.

        Parameters
        ----------
        now : float
            When the last of them did.
        stamp : Stamp
            Of that one.
        """
        self._received = self._labelled = now
        self._watch_time(*stamp)

    def _watch_time(self, *stamp):
        self._standing = self._standing + 1 if stamp == self._stamp and any(stamp) else 0
        self._stamp = stamp
        if self._standing == STANDING:
            self.once('standing', 'the stamps stand still: frames are taken to come evenly')

    def tracked(self, now, state):
        """Note what the tracker made of a frame.

        Parameters
        ----------
        now : float
        state : HandState or Glimpse
        """
        self._state = state
        palm = PalmState.TRACKED if state.palm is PalmState.CARRIED else state.palm
        if palm is not self._palm:
            self._palm, self._since = palm, now
            self._fault = FAULTS.get(palm, self._fault)
        if self._started is None and palm is PalmState.TRACKED:
            self._started = now
        # As floats: numpy would take five times as long for eight.
        residuals = list(filter(math.isfinite, state.residuals.tolist()))
        self._miss = sum(residuals) / len(residuals) if residuals else 0.
        if palm is not PalmState.TRACKED or self._miss <= OFF:
            self._off_since = None
        elif self._off_since is None:
            self._off_since = now
        self._off_for = 0. if self._off_since is None else now - self._off_since
        if palm is PalmState.TRACKED:
            self._fit.tracked(now, self._miss)
        self._markers.tracked(now, state, palm is PalmState.TRACKED)

    def ended(self):
        """Note that nothing more comes: what waits to be sure is said now."""
        self._name_the_never_seen()
        self._judge_fit(FIT_LEAST)

    def restarted(self):
        """Note that time jumped back."""
        self.once('restarted', 'the stamps jumped back, tracking begins anew; listeners of TF '
                  'that do not follow /clock (use_sim_time) ignore it until the stamps pass the '
                  'old ones')

    def once(self, key, text):
        """Have a warning said, once for each key and for a bounded number of keys.

        Parameters
        ----------
        key : hashable
        text : str
        """
        if key not in self._causes and len(self._causes) < CAUSES:
            self._causes.add(key)
            self._pending.append(text)

    def report(self, now, publishers):
        """Return what is to be logged.

        Parameters
        ----------
        now : float
        publishers : callable
            Returns a text on who publishes the markers; called when none come.

        Returns
        -------
        list of (bool, str)
            Whether it is a warning, and the line.
        """
        if self._started is not None and now - self._started >= NEVER:
            self._name_the_never_seen()
        self._judge_fit(FIT_FOR)
        lines = [(True, text) for text in self._pending]
        self._pending = []
        situation = self.situation(now)
        if situation is not None and situation != self._announced and self._budget.spend(now):
            is_tracked = situation is PalmState.TRACKED
            again = ' again' if is_tracked and self._has_tracked else ''
            lines.append((not is_tracked, self.describe(now, situation, publishers) + again))
            self._announced = situation
            self._has_tracked = self._has_tracked or is_tracked
        lines += [(is_warning, f'{text}: {self._expected(slots)}')
                  for is_warning, text, slots in self._markers.report(now)]
        return lines

    def situation(self, now):
        """Return what the input is like now.

        Parameters
        ----------
        now : float

        Returns
        -------
        PalmState, str or None
            'silent', 'unlabelled' or 'off' (the hand) prevail over the state of the palm;
            None when nothing has come yet.
        """
        if now - self._received > SILENT:
            return 'silent'
        if now - self._labelled > SILENT:
            return 'unlabelled'
        if self._off_for >= OFF_FOR:
            return 'off'
        return self._palm

    def describe(self, now, situation, publishers):
        """Return a situation in words.

        Parameters
        ----------
        now : float
        situation : PalmState, str or None
        publishers : callable
            As for `report`.

        Returns
        -------
        str
        """
        if situation is None:
            return f'no markers on {self._topic} yet'
        if situation == 'silent':
            return f'no markers on {self._topic} for {now - self._received:.0f} s: {publishers()}'
        if situation == 'unlabelled':
            return (f'messages on {self._topic} have held no marker of the hand for '
                    f'{now - self._labelled:.0f} s: {self._others()}; '
                    f'expected are the labels {self._expected(range(len(MARKERS)))}')
        if situation == 'off':
            return (f'the markers are on average {1e3 * self._miss:.0f} mm off the hand: '
                    'wrong side, labels or hand size?')
        if situation is PalmState.TRACKED:
            return 'tracking'
        if situation is PalmState.WAITING:
            hidden = np.flatnonzero(np.isnan(self._frame.positions[:len(PALM_MARKERS), 0]))
            if not hidden.size:
                return f'waiting for the palm: its markers are more than a kilometre away; {CHECK}'
            return (f'waiting for the palm: not seen yet {self._expected(hidden)}; '
                    f'{self._others()}')
        return f'{FAULTS[situation]}; since {now - self._since:.1f} s, the last pose is kept'

    def why_never(self):
        """Say why no frame of all was tracked.

        Returns
        -------
        str
        """
        if self._fault is not None:
            return self._fault
        if self._palm is PalmState.WAITING:
            return self.describe(self._since, self._palm, str)
        return (f'expected are the labels {self._expected(range(len(PALM_MARKERS)))}; '
                f'{self._others()}')

    def _others(self):
        """Say which markers the last message held that are none of the hand's."""
        if self._frame is None:
            return 'no message came'
        if self._frame.foreign:
            return f"there are markers in frame {', '.join(map(repr, self._frame.foreign))}"
        if self._frame.unknown:
            return 'there are ' + ', '.join(f"'{ns}/{i}'" for ns, i in self._frame.unknown)
        return 'there is no other point-like marker'

    def _expected(self, slots):
        return ', '.join(f"'{self.labels.labels[slot]}' ({MARKERS[slot]})" for slot in slots)

    def _judge_fit(self, least):
        miss = self._fit.mean(least)
        # What is farther off is another's hand, or mislabelled, and said as such.
        if miss is not None and UNFIT < miss <= OFF:
            self.once('fit', f'the markers are on average {1e3 * miss:.1f} mm off the hand, where '
                      '1 to 2 mm are usual for one that was measured: its fingers may stay too '
                      'straight; expected is a hand file (hand_file, hand:=, --hand) with the '
                      "lengths of your hand and the markers' offsets on the skin, as "
                      'config/hand.yaml explains')

    def _name_the_never_seen(self):
        if self._started is None:
            return
        never = [slot for slot in np.flatnonzero(self._state.marker_states == MarkerState.ABSENT)
                 if self.labels.labels[slot]]
        if never:
            self.once('never', f'never seen so far: {self._expected(never)}; {self._others()}')


def who_publishes(endpoints, reliability):
    """Say why no markers may come from the publishers of a topic.

    Parameters
    ----------
    endpoints : sequence of rclpy.topic_endpoint_info.TopicEndpointInfo
    reliability : str
        That this node asks for.

    Returns
    -------
    str
    """
    if not endpoints:
        return 'nothing publishes them (a remapping, ROS_DOMAIN_ID?)'
    for endpoint in endpoints:
        name = f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
        if endpoint.topic_type != MARKER_ARRAY:
            return f'{name} publishes {endpoint.topic_type}, not {MARKER_ARRAY}'
        if reliability == 'reliable' and endpoint.qos_profile.reliability.name != 'RELIABLE':
            return (f'{name} publishes with best effort, and qos.markers.reliability here is '
                    'reliable')
    return f'{name} publishes them, but sends nothing that arrives; is it paused?'
