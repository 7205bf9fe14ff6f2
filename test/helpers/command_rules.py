"""The rules that every command of a robot keeps, whatever comes in."""

import numpy as np


def use_deadman(guard, fault, now):
    """Press the deadman, unless a fault is that somebody disengages the robot, or releases it."""
    if fault == 'disengaged':
        guard.disengage()
    elif fault == 'released':
        guard.release()
    else:
        guard.press(now)


class CommandRules:
    """Check a stream of commands: finite, within limits, speed and acceleration, none unasked.

    Parameters
    ----------
    lower, upper, speed : ndarray, shape (n,)
        The URDF's limits; a speed of 0 is none.
    options : GuardOptions
    """

    def __init__(self, lower, upper, speed, options):
        self._lower, self._upper, self._options = lower, upper, options
        self._most = np.where(speed > 0., np.minimum(speed, options.max_speed), options.max_speed)
        self._inner = lower + options.limit_margin, upper - options.limit_margin
        self._last, self._time, self._may_move = None, 0., False
        self.sent = 0

    def expect(self, guard, robot, now):
        """Note, before a frame comes in, whether a command may follow, and from where."""
        self._may_move = guard.is_engaged
        if not self._may_move:
            self._last = None
        elif self._last is None:
            # It has just been engaged: where the robot was, is where it starts.
            self._last, self._time, self._velocity = robot.copy(), now, np.zeros(len(robot))

    def check(self, guard, command, now):
        """Check what came out, a command or None."""
        if command is None:
            self._velocity = np.zeros(len(self._lower))
            if not guard.is_engaged:
                self._last = None
            return
        self.sent += 1
        assert self._may_move
        assert np.isfinite(command).all()
        assert (command >= self._lower).all() and (command <= self._upper).all()
        since = min(max(now - self._time, 0.), self._options.max_dt)
        assert (np.abs(command - self._last) <= self._most * since + 1e-9).all()
        lower, upper = self._inner
        if since > 0.:
            velocity = (command - self._last) / since
            # Where a longer step than the last would lead over a limit, the limit counts.
            free = (command > lower + 1e-9) & (command < upper - 1e-9)
            assert (np.abs(velocity - self._velocity)[free]
                    <= self._options.max_acceleration * since + 1e-6).all()
            self._velocity = velocity
        inside = (self._last >= lower) & (self._last <= upper)
        assert (command >= lower - 1e-9)[inside].all()
        assert (command <= upper + 1e-9)[inside].all()
        self._time = max(now, self._time)
        self._last = command if guard.is_engaged else None
