"""Viewer page: draws the hand of a source at 30 Hz."""

import asyncio
import contextlib
import io
import socket
import time
from collections.abc import Callable
from typing import Any

from ..core.constraints import DEFAULT_CONSTRAINTS, describe
from ..core.errors import HandTrackerError
from ..core.model.kinematics import Pose
from ..core.tracker import HandState
from ..skin.skinning import Skin
from .panel import Panel
from .scene import HAND_SPACING, Framing, HandScene, anchor_near, light, wrist_pose
from .source import FrameSource

PAGE_RATE = 30.       # [Hz]
FIRST_PORT = 8080
PORT_ATTEMPTS = 100
LOCALHOST, ALL_INTERFACES = '127.0.0.1', '0.0.0.0'
DOCUMENTATION_ADDRESS = '192.0.2.1', 9    # reserved (RFC 5737); nothing is sent there


class Viewer:
    """Web page with one hand, or two for comparison.

    Parameters
    ----------
    host : str
        Address of this machine to listen at.
    port : int
        First port that is tried.

    Raises
    ------
    HandTrackerError
        If it cannot listen there.
    """

    def __init__(self, host: str = LOCALHOST, port: int = FIRST_PORT) -> None:
        import viser

        # viser's banner shows every address as "localhost"; the command prints its own.
        with contextlib.redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host, free_port(host, port), verbose=False)
        self._server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False)
        self._server.gui.set_panel_label('hand_tracker')
        self._server.gui.main_panel.dock_right()
        self._server.gui.main_panel.set_width(300)
        light(self._server.scene)
        self._hands = 1
        self._framings: dict[int, Framing] = {}
        # The server's initial camera could arrive at the browser after this one.
        self._server.on_client_connect(self._on_connect)
        self._server.on_client_disconnect(
            lambda client: self._framings.pop(client.client_id, None))
        self._waiting = self._server.gui.add_markdown('')

    @property
    def addresses(self) -> list[str]:
        """URLs of the page: on this machine, and in the network."""
        host = self._server.get_host()
        hosts = {LOCALHOST: ['localhost'], ALL_INTERFACES: ['localhost', *network_address()]}
        return [f'http://{name}:{self._server.get_port()}' for name in hosts.get(host, [host])]

    def _on_connect(self, client: Any) -> None:
        self._framings[client.client_id] = Framing(client.camera, self._hands)

    def say(self, text: str) -> None:
        """Show a line of text while there is no hand."""
        self._waiting.content = text

    def show(self, source: FrameSource, skin: Skin | None, running: Callable[[], bool]) -> None:
        """Show the hand of a source in a loop.

        Parameters
        ----------
        source : FrameSource
            Prepared.
        skin : Skin or None
        running : callable
            The loop ends when it returns False.
        """
        self._waiting.remove()
        scene = self._server.scene
        panel = Panel(self._server, source, skin is not None)
        hand = HandScene(scene, '/hand', source.hand, skin)
        bare = HandScene(scene, '/bare', source.hand, skin)
        bare.visible = False
        anchor: Pose | None = None
        due = time.monotonic()
        while running():
            # Without a browser nothing is tracked.
            looked_at = bool(self._server.get_clients())
            compared = looked_at and panel.compared.value
            source.set_demand(looked_at, compared)
            state = source.state() if looked_at else None
            if state is not None:
                anchor = (wrist_pose(state) if panel.held.value or anchor is None
                          else anchor_near(anchor, state))
                other = source.bare_state() if compared else None
                self._set_hands(1 + compared)

                async def draw(state: HandState = state, other: HandState | None = other,
                               anchor: Pose = anchor, compared: bool = compared) -> None:
                    with self._server.atomic():
                        for one in (hand, bare):
                            one.show(panel.skin.value, panel.skeleton.value, panel.markers.value)
                        hand.draw(state, anchor, .5 * HAND_SPACING * compared)
                        hand.caption(describe(source.constraints) if compared
                                     or not source.constraints >= DEFAULT_CONSTRAINTS else '')
                        bare.visible = other is not None
                        if other is not None:
                            bare.draw(other, anchor, -.5 * HAND_SPACING)
                            bare.caption(describe(()))
                        panel.refresh(state)

                # In viser's thread, as its message queue is not thread-safe.
                asyncio.run_coroutine_threadsafe(draw(), self._server.get_event_loop()).result()
            due = max(due + 1. / PAGE_RATE, time.monotonic())
            time.sleep(max(0., due - time.monotonic()))

    def _set_hands(self, hands: int) -> None:
        if hands != self._hands:
            self._hands = hands
            for framing in tuple(self._framings.values()):
                framing.frame(hands)

    def stop(self) -> None:
        """Close the page."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()


def free_port(host: str, port: int) -> int:
    """Return the first free port of a host, from `port` on.

    Raises
    ------
    HandTrackerError
        If there is none, or the host is not an address of this machine.
    """
    for candidate in range(port, min(port + PORT_ATTEMPTS, 2**16)):
        try:
            with socket.create_server((host, candidate)):
                return candidate
        except socket.gaierror as error:
            raise HandTrackerError(f'--host {host}: {error.strerror}') from None
        except OSError as error:
            reason = error.strerror
    raise HandTrackerError(f'--host {host} --port {port}: cannot listen there or at the next '
                           f'{PORT_ATTEMPTS} ports: {reason}')


def network_address() -> list[str]:
    """Return this machine's address in the network, as a list of at most one."""
    with contextlib.suppress(OSError), socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.connect(DOCUMENTATION_ADDRESS)
        return [probe.getsockname()[0]]
    return []
