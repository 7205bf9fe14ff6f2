"""The fast path: regular frames, from the middleware and back to it, in compiled code alone.

`FastPath` is the tracker's, `CommandPath` that of a robot that follows; `track_kernel`
and `command_kernel` are their arithmetic, `callback_path` what they share, `rcl` the C functions.
`PacketRelay` brings packets of a source in the same process to the tracker's, in the source's
thread, which then takes the place of the middleware's below.

States of a frame's way::

    stopped --start--> disabled --install--> enabled
                          ^                     |  a message that is not processed,
                          |                     |  a failed publication, disable()
                          +---------------------+
    disabled: the executor's thread takes messages (slow path) and owns the tracker's state
    enabled:  the middleware's thread takes messages and owns the tracker's state

A message that was taken but not processed is kept, and handed to the slow path first. Once that
has handled a message that is installed, the executor's thread lets the compiled callback process
what waits behind it; the fast path is enabled again when nothing waits. `stop` takes the callback
down while the executor is still there.

Lock order: the middleware's locks, then the mutex. Never wait for the GIL while holding the
mutex: the middleware's thread never asks for it.
"""

from .command_path import CommandPath, ListedJoints
from .packet_relay import PacketRelay
from .rcl import FastPathUnavailable
from .track_path import PUBLISHER_SILENCE, FastPath, InstalledHand

__all__ = ['PUBLISHER_SILENCE', 'CommandPath', 'FastPath', 'FastPathUnavailable', 'InstalledHand',
           'ListedJoints', 'PacketRelay']
