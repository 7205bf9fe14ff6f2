"""The fast path: regular frames, from the middleware and back to it, in compiled code alone.

`FastPath` is the tracker's, `CommandPath` that of a robot that follows; `kernel`
and `command_kernel` are their arithmetic, `callback_path` what they share, `rcl` the C functions.

States of a frame's way::

    stopped --start--> disabled --install--> enabled
                          ^                     |  a message that is not processed,
                          |                     |  a failed publication, disable()
                          +---------------------+
    disabled: the executor's thread takes messages (slow path) and owns the tracker's state
    enabled:  the middleware's thread takes messages and owns the tracker's state

A message that was taken but not processed is kept, and handed to the slow path first. The fast
path is enabled again once the slow path has handled all that waits, if the last message was
installed. `stop` takes the callback down while the executor is still there.

Lock order: the middleware's locks, then the mutex. Never wait for the GIL while holding the
mutex: the middleware's thread never asks for it.
"""

from .command_path import CommandPath, ListedJoints
from .middleware import FastPath, InstalledHand, InstalledReply
from .rcl import FastPathUnavailable

__all__ = ['CommandPath', 'FastPath', 'FastPathUnavailable', 'InstalledHand', 'InstalledReply',
           'ListedJoints']
