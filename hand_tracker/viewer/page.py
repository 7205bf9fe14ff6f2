"""Viewer page: draws the hand of a source at 30 Hz."""

import asyncio
import contextlib
import io
import secrets
import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..background import NewestCall
from ..core.constraints import DEFAULT_CONSTRAINTS, describe
from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..core.model.kinematics import Pose
from ..core.tracker import HandState
from ..retargeting.robot_file import LoadedRobot
from ..skin.skinning import Skin
from .page_guard import LOCAL_NAMES, PageGuard
from .page_options import FIRST_PORT, LOCALHOST
from .panel import Panel
from .robot_scene import RobotScene, robot_extent
from .scene import (
    HAND_SPACING,
    PERSON_EXTENT,
    Extent,
    Framing,
    HandScene,
    anchor_near,
    light,
    wrist_pose,
)
from .source import FrameSource

if TYPE_CHECKING:
    from viser import SceneApi

PAGE_RATE = 30.       # [Hz]
PORT_ATTEMPTS = 100
TOKEN_BYTES = 16
ALL_INTERFACES = '0.0.0.0'
DOCUMENTATION_ADDRESS = '192.0.2.1', 9    # reserved (RFC 5737); nothing is sent there


class Viewer:
    """Web page with one hand, two for comparison, or both hands of a person.

    Parameters
    ----------
    host : str
        Address of this machine to listen at.
    port : int
        First port that is tried.

    Raises
    ------
    HandTrackerError
        If it cannot listen there, or cannot be guarded.
    """

    def __init__(self, host: str = LOCALHOST, port: int = FIRST_PORT) -> None:
        import viser

        is_local = host in LOCAL_NAMES
        self._token = None if is_local else secrets.token_urlsafe(TOKEN_BYTES)
        guard = PageGuard(is_local, self._token)
        # viser's banner shows every address as "localhost"; the command prints its own.
        with contextlib.redirect_stdout(io.StringIO()), guard.around_servers() as started:
            self._server = viser.ViserServer(host, free_port(host, port), verbose=False)
        if not started:
            self._server.stop()
            raise HandTrackerError('this viser serves its page in another way than its releases '
                                   'from 0.2 on: it cannot be guarded')
        self._server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False)
        self._server.gui.set_panel_label('hand_tracker')
        self._server.gui.main_panel.dock_right()
        self._server.gui.main_panel.set_width(300)
        light(self._server.scene)
        self._hands, self._extent = 1, PERSON_EXTENT
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
        hosts = {LOCALHOST: ['localhost'], ALL_INTERFACES: ['localhost', *_network_address()]}
        query = '' if self._token is None else f'/?token={self._token}'
        return [f'http://{name}:{self._server.get_port()}{query}'
                for name in hosts.get(host, [host])]

    def _on_connect(self, client: Any) -> None:
        self._framings[client.client_id] = Framing(client.camera, self._hands, self._extent)

    def say(self, text: str) -> None:
        """Show a line of text while there is no hand."""
        self._waiting.content = text

    def show(self, source: FrameSource, skin_of: Callable[[Hand], Skin | None],
             running: Callable[[], bool], robot: LoadedRobot | None = None) -> None:
        """Show the hand of a source in a loop, and beside it a robot that follows it.

        Parameters
        ----------
        source : FrameSource
            Prepared.
        skin_of : callable
            Returns the skin of a hand, None where there is none; slow.
        running : callable
            The loop ends when it returns False.
        robot : LoadedRobot, optional
            It follows the hand of `source`.

        Raises
        ------
        InvalidRobot
            If robot and hand do not fit.
        """
        self._waiting.remove()
        if robot is not None:
            self._set_extent(PERSON_EXTENT.joined(robot_extent(robot.hand)))
        hands = [ShownHand(self._server.scene, '/hand', source, skin_of, robot)]
        if source.beside is not None:
            hands.append(ShownHand(self._server.scene, '/other_hand', source.beside, skin_of))
        from_the_left = sorted(hands, key=lambda one: one.source.hand.side)
        panel = Panel(self._server, source, hands[0].has_skin)
        due = time.monotonic()
        while running():
            # Without a browser nothing is tracked.
            looked_at = bool(self._server.get_clients())
            compared = looked_at and panel.compared.value
            for one in hands:
                one.follow(looked_at, compared)
            if any(one.state is not None for one in hands):
                self._set_hands(sum(one.count for one in hands))

                async def draw(compared: bool = compared) -> None:
                    left = .5 * (self._hands - 1) * HAND_SPACING
                    with self._server.atomic():
                        for one in from_the_left:
                            one.draw(panel, left, compared)
                            left -= one.count * HAND_SPACING
                        if hands[0].state is not None:
                            panel.refresh(hands[0].state)

                # In viser's thread, as its message queue is not thread-safe.
                asyncio.run_coroutine_threadsafe(draw(), self._server.get_event_loop()).result()
            due = max(due + 1. / PAGE_RATE, time.monotonic())
            time.sleep(max(0., due - time.monotonic()))

    def _set_extent(self, extent: Extent) -> None:
        """Frame hands of another extent, in open browsers too."""
        self._extent = extent
        for framing in tuple(self._framings.values()):
            framing.set_extent(extent)

    def _set_hands(self, hands: int) -> None:
        if hands != self._hands:
            self._hands = hands
            for framing in tuple(self._framings.values()):
                framing.frame(hands)

    def stop(self) -> None:
        """Close the page."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()


class ShownHand:
    """The hand of a source in the scene, the same without constraints, and a robot's beside it.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
        Of its node.
    source : FrameSource
    skin_of : callable
        See `Viewer.show`.
    robot : LoadedRobot, optional

    Attributes
    ----------
    source : FrameSource
    state : HandState or None
        Of the present frame.
    has_skin : bool
    count : int
        Hands side by side: this, with the one without constraints and the robot.
    """

    def __init__(self, scene: 'SceneApi', name: str, source: FrameSource,
                 skin_of: Callable[[Hand], Skin | None],
                 robot: LoadedRobot | None = None) -> None:
        self.source, self._robot = source, robot
        self.count = 1
        self.state: HandState | None = None
        self._scene, self._name, self._loading = scene, name, NewestCall(skin_of)
        self._hand = source.hand
        self._anchor: Pose | None = None
        self._bare_state: HandState | None = None
        skin = skin_of(self._hand)
        self.has_skin = skin is not None
        self._add(self._hand, skin)

    def _add(self, hand: Hand, skin: Skin | None) -> None:
        """Add the hand to the scene, and the hidden one without constraints."""
        self._shown, self._bare = (HandScene(self._scene, f'{self._name}{of}', hand, skin)
                                   for of in ('', '_bare'))
        self._shown.visible = self._bare.visible = False
        self._follower = (None if self._robot is None
                          else RobotScene(self._scene, '/robot', self._robot, hand))

    def follow(self, looked_at: bool, compared: bool) -> None:
        """Show the source's present hand and frame; subscribe only to what is shown."""
        self.source.set_demand(looked_at, compared)
        if self.source.hand is not self._hand:
            self._hand = self.source.hand
            self._loading.ask(self._hand)
        if (loaded := self._loading.poll()) is not None:
            self._shown.remove()
            self._bare.remove()
            if self._follower is not None:
                self._follower.remove()
            self._add(*loaded)
        self.state = self.source.state() if looked_at else None
        self._bare_state = self.source.bare_state() if looked_at and compared else None
        self.count = 1 + compared + (self._follower is not None)

    def draw(self, panel: Panel, offset: float, compared: bool) -> None:
        """Draw the frame, if there is one, at an offset to the left [m]."""
        if self.state is None:
            return
        for one in (self._shown, self._bare):
            one.show(panel.skin.value, panel.skeleton.value, panel.markers.value)
        self._anchor = (wrist_pose(self.state) if panel.held.value or self._anchor is None
                        else anchor_near(self._anchor, self.state))
        constraints = self.source.constraints
        self._shown.visible = True
        self._shown.draw(self.state, self._anchor, offset)
        self._shown.caption(describe(constraints) if compared
                            or not constraints >= DEFAULT_CONSTRAINTS else '')
        self._bare.visible = self._bare_state is not None
        if self._bare_state is not None:
            self._bare.draw(self._bare_state, self._anchor, offset - HAND_SPACING)
            self._bare.caption(describe(()))
        if self._follower is not None:
            self._follower.draw(self.state, self._anchor, offset - (self.count - 1) * HAND_SPACING)


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


def _network_address() -> list[str]:
    """Return this machine's address in the network, as a list of at most one."""
    with contextlib.suppress(OSError), socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.connect(DOCUMENTATION_ADDRESS)
        return [probe.getsockname()[0]]
    return []
