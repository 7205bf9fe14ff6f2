"""The viewer: a page that shows a source's hand thirty times a second."""

import asyncio
import contextlib
import io
import socket
import time

from ..core.constraints import DEFAULT_CONSTRAINTS, describe
from ..core.errors import HandTrackerError
from .panel import Panel
from .scene import APART, Framing, HandScene, kept_near, light, wrist_pose

RATE = 30.       # [Hz]
PORT = 8080
PORTS = 100      # that are tried from the first on
LOCALHOST, EVERYWHERE = '127.0.0.1', '0.0.0.0'
REMOTE = '192.0.2.1', 9    # an address for documentation (RFC 5737): nothing is sent there


class Viewer:
    """A page with one hand, or two.

    Parameters
    ----------
    host : str
        Address of this machine at which it listens.
    port : int
        The first that is tried.

    Raises
    ------
    HandTrackerError
        If it cannot listen there.
    """

    def __init__(self, host=LOCALHOST, port=PORT):
        import viser

        # Its own banner names every address "localhost"; ours is printed by the command.
        with contextlib.redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host, free_port(host, port), verbose=False)
        self._server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False)
        self._server.gui.set_panel_label('hand_tracker')
        self._server.gui.main_panel.dock_right()
        self._server.gui.main_panel.set_width(300)
        light(self._server.scene)
        self._hands, self._framings = 1, {}
        # Not the server's initial camera: a browser may take that after this one.
        self._server.on_client_connect(self._on_connect)
        self._server.on_client_disconnect(
            lambda client: self._framings.pop(client.client_id, None))
        self._waiting = self._server.gui.add_markdown('')

    @property
    def addresses(self):
        """Where a browser finds the page: on this machine, and from elsewhere in the network."""
        host = self._server.get_host()
        hosts = {LOCALHOST: ['localhost'], EVERYWHERE: ['localhost', *network_address()]}
        return [f'http://{name}:{self._server.get_port()}' for name in hosts.get(host, [host])]

    def _on_connect(self, client):
        self._framings[client.client_id] = Framing(client.camera, self._hands)

    def say(self, text):
        """Show a line while there is no hand yet."""
        self._waiting.content = text

    def show(self, source, skin, running):
        """Show a source's hand until told otherwise.

        Parameters
        ----------
        source : Recording or Live
            Prepared.
        skin : Skin or None
        running : callable
            Returns whether to go on.
        """
        self._waiting.remove()
        scene = self._server.scene
        panel = Panel(self._server, source, skin is not None)
        hand = HandScene(scene, '/hand', source.hand, skin)
        bare = HandScene(scene, '/bare', source.hand, skin)
        bare.visible = False
        anchor = None
        due = time.monotonic()
        while running():
            # Nobody looks: nothing is worked out.
            looked_at = bool(self._server.get_clients())
            compared = looked_at and panel.compared.value
            source.attend(looked_at, compared)
            state = source.state() if looked_at else None
            if state is not None:
                held = panel.held.value or anchor is None
                anchor = wrist_pose(state) if held else kept_near(anchor, state)
                other = source.bare_state() if compared else None
                self._set_hands(1 + compared)

                async def draw(state=state, other=other, anchor=anchor, compared=compared):
                    with self._server.atomic():
                        for one in (hand, bare):
                            one.show(panel.skin.value, panel.skeleton.value, panel.markers.value)
                        hand.draw(state, anchor, .5 * APART * compared)
                        hand.caption(describe(source.constraints) if compared
                                     or not source.constraints >= DEFAULT_CONSTRAINTS else '')
                        bare.visible = other is not None
                        if other is not None:
                            bare.draw(other, anchor, -.5 * APART)
                            bare.caption(describe(()))
                        panel.tell(state)

                # In viser's own thread: a message from another may find its queue changing.
                asyncio.run_coroutine_threadsafe(draw(), self._server.get_event_loop()).result()
            due = max(due + 1. / RATE, time.monotonic())
            time.sleep(max(0., due - time.monotonic()))

    def _set_hands(self, hands):
        if hands != self._hands:
            self._hands = hands
            for framing in tuple(self._framings.values()):
                framing.frame(hands)

    def stop(self):
        """Close the page."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()


def free_port(host, port):
    """Return the first port from `port` on at which a host can listen.

    Raises
    ------
    HandTrackerError
        If there is none, or the host is none of this machine.
    """
    for candidate in range(port, min(port + PORTS, 2**16)):
        try:
            with socket.create_server((host, candidate)):
                return candidate
        except socket.gaierror as error:
            raise HandTrackerError(f'--host {host}: {error.strerror}') from None
        except OSError as error:
            lack = error.strerror
    raise HandTrackerError(f'--host {host} --port {port}: cannot listen there or at the next '
                           f'{PORTS} ports: {lack}')


def network_address():
    """Return this machine's address in the network, in a list that is empty if it has none."""
    with contextlib.suppress(OSError), socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.connect(REMOTE)
        return [probe.getsockname()[0]]
    return []
