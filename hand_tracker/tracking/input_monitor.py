"""Monitor the tracker's input: log lines on changes of its state, and on each cause once.

Lines are collected frame by frame and asked for a few times a second, so that nothing is ever
logged at the rate of the markers.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from ..core.labelling.validity import COORDINATE_LIMIT
from ..core.model.hand import BOTH
from ..core.model.marker_layout import MARKERS, PALM_MARKERS
from ..core.model.states import MarkerState, PalmState
from ..core.pose.report import mean_residual
from ..core.tracker import HandState
from ..messages.labels import LabelMap
from ..messages.marker_array import MarkerFrame
from ..messages.stamps import NO_STAMP, Stamp, Time, is_repeated, seconds
from .fit_check import BAD_FIT_RESIDUAL, FAR_OFF_AFTER, OFF_HAND_DISTANCE, FitCheck
from .marker_events import MarkerEvents
from .rate_limit import LogRateLimiter, OncePerKey
from .setting_names import PARAMETER_NAMES, SettingNames
from .side_check import side_fault

SILENT_AFTER = 3.   # [s] without markers before that is said
# [s] from the start in which no markers need come yet: their source may still be starting.
START_UP = 20.
SENDS_NOTHING = 'sends nothing that arrives; is it paused?'
UNDISCOVERED = 'a node not yet discovered'
NEVER_SEEN_AFTER = 5.    # [s] of tracking before a marker that was never seen is named
WRONG_UNIT = .1      # [m] that markers are off the hand on average where the unit may be wrong
STANDING_STAMPS = 10  # frames in a row with one stamp before that is said

SLOW_LABELLING = 'most frames are left out until the kernels that label points are compiled'

SIDES_EXCHANGED = 'left and right exchanged, as neither hand fits'
FAR_AWAY = 'its markers are more than a kilometre away'
PALM_FAULTS = {
    PalmState.LOST: 'the palm is lost: none of its markers is seen',
    PalmState.COINCIDENT: 'palm markers coincide',
    PalmState.COLLINEAR: 'the palm markers lie on one line',
    PalmState.TOO_FAR_APART: 'the palm markers are too far apart for this hand',
    PalmState.TOO_CLOSE: 'the palm markers are too close together for this hand',
}


class StateRun(NamedTuple):
    """Consecutive frames with the same states of palm and markers.

    Attributes
    ----------
    palm : PalmState
    marker_states : ndarray of int, shape (n,)
    residuals : ndarray, shape (1,)
        Mean of the frames' mean residuals [m].
    """

    palm: PalmState
    marker_states: np.ndarray
    residuals: np.ndarray


class InputMonitor:
    """Monitor the input of one tracker.

    Parameters
    ----------
    now : float
        Of a clock that never jumps, as in every method [s].
    topic : str
        Where the markers come from.
    labels : LabelMap
    names : SettingNames, optional
        Those of the node's parameters when left out.

    Attributes
    ----------
    bends_away_from : str or None
        Side of a hand from whose palm the fingers bend away.
    label_doubt : str or None
        Which labels look exchanged.
    learned_size : str
        Size of the hand in words, where it was learned from its markers.
    awaits_labelling, why_not_found
        As of `Stream`.
    other_hand : InputMonitor or None
        Of the other hand of one person.
    fit : FitCheck
    events : MarkerEvents
    """

    def __init__(self, now: float, topic: str, labels: LabelMap,
                 names: SettingNames = PARAMETER_NAMES) -> None:
        self.labels, self.names = labels, names
        self._topic = topic
        self._start = self._received = self._labelled = self._since = now
        self._has_received, self._unreadable = False, ''
        self._palm: PalmState | None = None
        self._frame: MarkerFrame | None = None
        self._state: HandState | StateRun | None = None
        self._started: float | None = None
        self._fault: str | None = None
        self.fit = FitCheck()
        self.other_hand: InputMonitor | None = None
        self._announced: PalmState | str | None = None
        self._has_tracked = False
        self._stamp = NO_STAMP
        self._standing = 0
        self.bends_away_from: str | None = None
        self.label_doubt: str | None = None
        self._doubts = 0    # that were over
        self.learned_size = ''
        self.awaits_labelling, self.why_not_found = False, ''
        self._limiter = LogRateLimiter()
        self.events = MarkerEvents(len(labels.labels))
        self._once = OncePerKey()
        self._pending: list[str] = []

    def received(self, now: float, frame: MarkerFrame) -> None:
        """Note the contents of a message.

        Parameters
        ----------
        now : float
            On a clock that never jumps [s].
        frame : MarkerFrame
        """
        if not self._has_received:
            self._labelled = now
        former = '' if self._frame is None else self._frame.frame_id
        self._received, self._frame, self._has_received = now, frame, True
        self._unreadable = ''
        if former and frame.frame_id not in ('', former):
            self.warn_once('other frame', f"the markers' frame changes from '{former}' to "
                           f"'{frame.frame_id}', as if it were the same place; to leave others "
                           f'out: {self.names.frame}')
        if frame.stamp is not None:
            self.received_alike(now, frame.stamp)
        for name in frame.foreign:
            self.warn_once(('frame', name), f"markers in frame '{name}' are left out, as those of "
                           f"frame '{frame.frame_id}' are tracked ({self.names.frame})")
        if frame.unknown and (other := self._other_hand(frame)):
            self.warn_once('other hand', other)
        new = [slot for slot in frame.doubled if self._once.allows(('doubled', slot))]
        if new:
            self._pending.append(self._doubled_text(new))

    def _doubled_text(self, slots: list[int]) -> str:
        """Describe labels to which several markers of one message answer."""
        slot, *others = slots
        precise = self.names.label.format(self.labels.names[slot])
        more = f', and so it is with {len(others)} more labels' if others else ''
        cure = f'A more precise {precise} tells them apart'
        if self.labels.labels[slot].isdecimal():
            cure += f'. If they are of two hands, {self.names.side.format(BOTH)} tracks both'
        return f'{self.labels.doubled(slot)}{more}; the last one counts. {cure}'

    def received_unreadable(self, key: Hashable, fault: str) -> None:
        """Note a message that is none of markers, and why; warn as `warn_once`."""
        self._unreadable = fault
        self.warn_once(key, fault)

    def received_alike(self, now: float, stamp: Time) -> None:
        """Note messages with the signature of the last one.

        Parameters
        ----------
        now : float
            When the last of them came [s].
        stamp : Time
            Of that one.
        """
        self._received = self._labelled = now
        self._has_received, self._unreadable = True, ''
        stands = seconds(stamp) is not None and is_repeated(
            stamp.sec, stamp.nanosec, *self._stamp)
        self._standing = self._standing + 1 if stands else 0
        self._stamp = Stamp(stamp.sec, stamp.nanosec)
        if self._standing == STANDING_STAMPS:
            self.warn_once(
                'standing', 'the stamps stand still: frames are taken to come evenly')

    def tracked(self, now: float, state: HandState | StateRun) -> None:
        """Note the result of a frame.

        Parameters
        ----------
        now : float
            On a clock that never jumps [s].
        state : HandState or StateRun
        """
        self._state = state
        palm = PalmState.TRACKED if state.palm is PalmState.CARRIED else state.palm
        if palm is not self._palm:
            self._palm, self._since = palm, now
            self._fault = self._palm_fault(palm) if palm in PALM_FAULTS else self._fault
        if self._started is None and palm is PalmState.TRACKED:
            self._started = now
        is_tracked = palm is PalmState.TRACKED
        self.fit.add(now, mean_residual(state.residuals), is_tracked,
                     is_of_side=self.bends_away_from is None)
        if (self.fit.far_off_for >= FAR_OFF_AFTER and self.fit.residual > OFF_HAND_DISTANCE
                and self._is_other_hand_off):
            self.fit.leave_out()
        self.events.update(now, state.marker_states, is_tracked)

    def exchanged(self, rather: Mapping[int, int]) -> None:
        """Note which markers are rather others, as of `LabelCheck.add`, until noted anew."""
        names = self.labels.names
        if not rather and self.label_doubt is not None:
            self._doubts += 1   # the same may be said again
        self.label_doubt = None
        if rather:
            places = ', '.join(f'{self._expected([slot])} stays where {names[other]} should be'
                               for slot, other in rather.items())
            self.label_doubt = f'labels look exchanged: {places}'
            self.warn_once(('exchanged', places, self._doubts),
                           f'{self.label_doubt}; check {self.names.labels}')

    def note_side(self, side: str, is_other_side: bool | None) -> bool:
        """Note a verdict of a `SideCheck`; return whether the hand is known to be of this side.

        Parameters
        ----------
        side : {'right', 'left'}
            That is tracked.
        is_other_side : bool or None
            None as long as it is not known.
        """
        if is_other_side is not None:
            self.bends_away_from = side if is_other_side else None
        return is_other_side is False

    def ended(self) -> None:
        """Note the end of the input: judge now what else waits for more frames."""
        self._name_the_never_seen()
        miss = self.fit.end()
        if not (self.fit.has_fitted or self.is_wrong) and self.fit.mean > OFF_HAND_DISTANCE:
            # However few frames they are, all being off tells of a wrong setting.
            miss = self.fit.mean
            self.warn_once(
                'fit', f'in every tracked frame {self._off(miss)}: {self._why_off(miss)}?')
        elif miss is not None:
            self._warn_of_bad_fit(miss)
            if miss > OFF_HAND_DISTANCE and not self.is_wrong:
                self.warn_once('fit', f'{self._off(miss)}: {self._why_off(miss)}?')

    def restarted(self) -> None:
        """Note that time jumped back."""
        self._fault = None
        self.warn_once('restarted', 'the stamps jumped back, tracking begins anew; listeners of TF '
                  'that do not follow /clock (use_sim_time) ignore it until the stamps pass the '
                  'old ones')

    def warn_once(self, key: Hashable, text: str) -> None:
        """Log a warning once for each key, for a bounded number of keys.

        Parameters
        ----------
        key : hashable
        text : str
        """
        if self._once.allows(key):
            self._pending.append(text)

    def report(self, now: float,
               publishers: Callable[[], str | None]) -> list[tuple[bool, str]]:
        """Return the lines to log.

        Parameters
        ----------
        now : float
            On a clock that never jumps [s].
        publishers : callable
            Returns a text on who publishes the markers, None where nothing does; called when
            none come.

        Returns
        -------
        list of (bool, str)
            Whether it is a warning, and the line.
        """
        if self._started is not None and now - self._started >= NEVER_SEEN_AFTER:
            self._name_the_never_seen()
        if (miss := self.fit.judge()) is not None:
            self._warn_of_bad_fit(miss)
        lines = [(True, text) for text in self._pending]
        self._pending = []
        situation, who = self.situation(now), None
        if situation == 'silent' and situation != self._announced:
            who = publishers()
            if not self._has_received and now - self._start < START_UP and (
                    who is None or who.startswith(UNDISCOVERED) or who.endswith(SENDS_NOTHING)):
                situation = None
        if situation == 'slow' or situation is PalmState.WAITING and self._fault is not None:
            situation = None    # that, or what is wrong with the palm, is said already
        if situation is not None and situation != self._announced and self._limiter.allows(now):
            is_tracked = situation is PalmState.TRACKED
            # A source that has ended is no fault: a recording was played, say.
            has_ended = situation == 'silent' and who is None and self._has_received
            again = ' again' if is_tracked and self._has_tracked else ''
            lines.append((not is_tracked and not has_ended,
                          self.describe(now, situation, lambda: who) + again))
            self._announced = situation
            self._has_tracked = self._has_tracked or is_tracked
        # Of a hand of the other side all that is wrong with its markers follows from that.
        if self.bends_away_from is None:
            lines += [(is_warning, f'{text}: {self._expected(slots)}')
                      for is_warning, text, slots in self.events.report(now)]
        return lines

    @property
    def is_wrong(self) -> bool:
        """Whether the markers are of the other hand, or far off the hand for long."""
        return self.bends_away_from is not None or self.fit.is_off or self.fit.is_misfit

    def quiet_for(self, now: float) -> float:
        """Return the time without a marker of the hand at a time `now` [s]."""
        return now - self._labelled

    def situation(self, now: float) -> PalmState | str | None:
        """Return the situation of the input.

        Parameters
        ----------
        now : float
            On a clock that never jumps [s].

        Returns
        -------
        PalmState, str or None
            'silent', 'unlabelled', 'mirrored' or 'off' (the hand) prevail over the state of the
            palm; 'slow' over what too few frames may look like; None when nothing has come yet.
        """
        if now - self._received > SILENT_AFTER:
            found: PalmState | str | None = 'silent'
        elif now - self._labelled > SILENT_AFTER:
            found = 'unlabelled'
        elif self.bends_away_from is not None:
            return 'mirrored'
        elif self._palm is PalmState.TRACKED and (self.fit.is_off or self.fit.is_misfit):
            return 'off'
        else:
            found = self._palm
        is_slow = self.awaits_labelling and self._has_received
        return 'slow' if is_slow and found is not PalmState.TRACKED else found

    def describe(self, now: float, situation: PalmState | str | None,
                 publishers: Callable[[], str | None]) -> str:
        """Describe a situation in words.

        Parameters
        ----------
        now : float
            On a clock that never jumps [s].
        situation : PalmState, str or None
        publishers : callable
            As for `report`.

        Returns
        -------
        str
        """
        if situation is None:
            return f'no markers on {self._topic} yet'
        if situation == 'slow':
            return SLOW_LABELLING
        if situation == 'silent':
            why = publishers()
            if self._unreadable:
                sender = (why or '').removesuffix(f', but {SENDS_NOTHING}')
                why = '; '.join(filter(None, (self._unreadable, sender)))
            if why is None:
                why = ('what published them has ended' if self._has_received else
                       'nothing publishes them (a remapping, ROS_DOMAIN_ID?)')
            return f'no markers on {self._topic} for {now - self._received:.0f} s: {why}'
        if situation == 'unlabelled':
            found = filter(None, (self._others(), self._wanted(range(len(self.labels.names)))))
            return (f'{self.names.messages} {self._topic} have held no marker of the hand for '
                    f'{self.quiet_for(now):.0f} s: {"; ".join(found)}')
        if (fault := self.side_fault()) is not None and situation == 'mirrored':
            return fault
        if situation == 'off':
            miss = self.fit.residual if self.fit.is_off else self.fit.misfit
            return f'{self._off(miss)}, which is left out: {self._why_off(miss)}?'
        if situation is PalmState.TRACKED:
            return 'tracking'
        if situation is PalmState.WAITING:
            assert self._frame is not None
            palm = self._palm_slots()
            hidden = palm[np.isnan(self._frame.positions[palm, 0])]
            if not hidden.size:
                return f'waiting for the palm: {FAR_AWAY}; {self._what_to_check()}'
            if self._has_no_labels and np.isnan(self._frame.positions).all():
                return f'waiting for the palm: no hand is found yet; {self._others()}'
            return (f'waiting for the palm: not seen yet {self._expected(hidden)}; '
                    f'{self._others()}')
        assert isinstance(situation, PalmState)
        kept = f'; since {now - self._since:.1f} s, ' + (
            'and before it did not fit: left out' if self.is_wrong else 'the last pose is kept')
        return self._palm_fault(situation) + (kept if self._started is not None else '')

    def _palm_fault(self, palm: PalmState) -> str:
        if palm is PalmState.LOST and self._frame is not None and (
                np.abs(self._frame.positions[self._palm_slots()]) > COORDINATE_LIMIT).any():
            return f'the palm is lost: {FAR_AWAY}; {self._what_to_check()}'
        is_of_size = palm in (PalmState.TOO_FAR_APART, PalmState.TOO_CLOSE)
        return PALM_FAULTS[palm] + (f': {self._what_to_check()}' if is_of_size else '')

    def _what_to_check(self) -> str:
        return f'check {self.names.scale}, the size of the hand and {self.names.labels}'

    @staticmethod
    def _off(miss: float) -> str:
        return f'the markers are on average {1e3 * miss:.0f} mm off the hand'

    def _why_off(self, miss: float) -> str:
        if self.label_doubt is not None:
            return f'{self.label_doubt} ({self.names.labels})'
        unit = f'unit ({self.names.scale}), ' if miss > WRONG_UNIT else ''
        sides = f'{SIDES_EXCHANGED}, or ' if self._is_other_hand_off else ''
        return (f'{sides}wrong {unit}side, labels, layout or hand size (a hand file says it: '
                f'{self.names.hand})' + (f', or {other}' if (other := self._other_person) else ''))

    @property
    def _is_other_hand_off(self) -> bool:
        other = self.other_hand
        return (other is not None and self._labelled - other._labelled < FAR_OFF_AFTER
                and (other.bends_away_from is not None
                     or other.fit.far_off_for >= FAR_OFF_AFTER))

    @property
    def _other_person(self) -> str:
        """What else may be wrong where the size was learned, and its cure."""
        if not (self.learned_size and self.names.reset):
            return ''
        return (f'another person than the one whose size was learned ({self.learned_size}; '
                f'{self.names.reset} learns it anew)')

    def side_fault(self) -> str | None:
        """Return why a hand is of the other side, or None."""
        side = self.bends_away_from
        if side is None:
            return None
        if self.label_doubt is not None:
            return (f'the fingers bend away from the palm of a {side} hand, which is left out: '
                    f'{self.label_doubt}; check {self.names.labels}')
        both = self._frame is not None and len(self._frame.doubled) > 1
        if self._is_other_hand_off:
            return f'{side_fault(side, self.names)}; or {SIDES_EXCHANGED}'
        return side_fault(side, self.names) + (
            f'; markers of both hands are told apart with {self.names.side.format(BOTH)}'
            if both else '')

    def why_never(self) -> str:
        """Explain why no frame at all was tracked.

        Returns
        -------
        str
        """
        if self._fault is not None:
            return self._fault
        if self._palm is PalmState.WAITING:
            return self.describe(self._since, self._palm, str)
        return '; '.join(filter(None, (self._wanted(self._palm_slots()), self._others())))

    @property
    def _has_no_labels(self) -> bool:
        return self._frame is not None and self._frame.searched is not None

    def _wanted(self, slots: Iterable[int] | np.ndarray) -> str:
        """Describe what is expected in place of the markers that are not of the hand, if any."""
        if self._frame is not None and self._frame.foreign:
            return f"expected is frame '{self._frame.frame_id}' ({self.names.frame})"
        return '' if self._has_no_labels else f'expected are the labels {self._expected(slots)}'

    def _others(self) -> str:
        """Describe the markers of the last message that are not of the hand."""
        if self._frame is None:
            return 'no message came'
        if self._frame.foreign:
            return f"there are markers in frame {', '.join(map(repr, self._frame.foreign))}"
        if self._has_no_labels:
            return f'there are {self._frame.points_seen} points without labels'
        if self._frame.unknown:
            return '; '.join(filter(None, (
                'there are ' + ', '.join(f"'{ns}/{i}'" for ns, i in self._frame.unknown),
                self._other_hand(self._frame), self._shifted_ids(self._frame))))
        if self._frame.doubled:
            return '; '.join(map(self.labels.doubled, self._frame.doubled))
        return 'there is no other point-like marker'

    def _shifted_ids(self, frame: MarkerFrame) -> str:
        """Ask whether ids begin with 1, where the first expected one is missing."""
        labels = self.labels.labels
        is_shifted = (list(labels) == [*map(str, range(len(labels)))]
                      and np.isnan(frame.positions[0]).any()
                      and [number for _, number in frame.unknown] == [len(labels)])
        return f'do the ids begin with 1? Then set {self.names.labels}' if is_shifted else ''

    def _other_hand(self, frame: MarkerFrame) -> str:
        """Describe markers that are left out as they are in the other side's namespace, if any."""
        side = self.labels.not_of
        if not side or all(label[0] != side for label in frame.unknown):
            return ''
        return (f"markers of namespace '{side}' are left out, as the {side} hand's: "
                f'{self.names.side.format(side)}, {self.names.side.format(BOTH)}, or '
                f'{self.names.labels} with the namespace')

    def _palm_slots(self) -> np.ndarray:
        """Return the palm's markers; of another layout than the paper's eight, all."""
        names = self.labels.names
        return np.arange(len(PALM_MARKERS if names == MARKERS else names))

    def _expected(self, slots: Iterable[int] | np.ndarray) -> str:
        labels, names = self.labels.labels, self.labels.names
        if self._has_no_labels:
            return ', '.join(names[slot] for slot in slots)
        # Markers that are not worn have no label.
        return ', '.join(self.names.marker.format(label=labels[slot], name=names[slot])
                         if labels[slot] else names[slot] for slot in slots)

    def _warn_of_bad_fit(self, miss: float) -> None:
        """Warn of a hand that is a bad fit by its mean residual [m]."""
        # What is farther off is another's hand, or mislabelled, and said as such.
        if self.label_doubt is None and BAD_FIT_RESIDUAL < miss <= OFF_HAND_DISTANCE:
            self.warn_once(
                'fit', f'the markers are on average {1e3 * miss:.1f} mm off the hand, where '
                '1 to 2 mm are usual for one that was measured: its fingers may stay too '
                f'straight; expected is a hand file ({self.names.hand}) with the '
                "lengths of your hand and the markers' offsets on the skin, as "
                'config/hand.yaml explains, and each marker with its own label '
                f'({self.names.labels})'
                + (f'; or is it {other}?' if (other := self._other_person) else ''))

    def _name_the_never_seen(self) -> None:
        if self._started is None:
            return
        assert self._state is not None
        absent = np.flatnonzero(self._state.marker_states == MarkerState.ABSENT)
        never = [slot for slot in absent.tolist() if self.labels.labels[slot]]
        if never:
            most = len(self.labels.names) / 2.
            doubt = '; are the markers of another layout?' if len(never) > most else ''
            self.warn_once('never', f'never seen so far: {self._expected(never)}; '
                           f'{self._others()}{doubt}')
