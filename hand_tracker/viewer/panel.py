"""Control panel of the viewer: numbers, playback, visibility, constraints, angles."""

import io
import time
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from ..core.constraints import CONSTRAINTS
from ..core.model.states import MarkerState
from ..core.tracker import HandState
from ..drawing.palette import MARKER_COLOURS
from .angle_bars import angle_bars
from .coverage_bars import coverage_bars
from .source import FrameSource

if TYPE_CHECKING:
    from viser import CameraHandle, GuiApi, ViserServer

SPEEDS = {'0.1 ×': .1, '0.25 ×': .25, '0.5 ×': .5, '1 ×': 1., '2 ×': 2.}
PAUSE_LABEL, PLAY_LABEL = 'Pause', 'Play'
REFRESH_PERIOD = .1     # [s] of numbers, bars and slider
SLIDER_HOLD_TIME = .5      # [s] after the user moved the slider
PNG_SIZE = 1600     # [px] of the longer edge
ANGLES_WIDTH = 260  # [px]
MIN_WIDTH_WITH_ANGLES, MIN_HEIGHT_WITH_ANGLES = 720, 450   # [px] of the picture
WIDTH_HYSTERESIS = 60          # [px] before the angles are folded again
RENDER_TIMEOUT = 20.      # [s] of the browser
NUMBERS_STYLE = ('padding:6px 12px;font:12px/1.5 system-ui,sans-serif;'
        'font-variant-numeric:tabular-nums')


class Panel:
    """Controls and numbers beside the hand.

    Parameters
    ----------
    server : viser.ViserServer
    source : FrameSource
    has_skin : bool
    """

    def __init__(self, server: 'ViserServer', source: FrameSource, has_skin: bool) -> None:
        self._server, self._source = server, source
        self._angles: dict[int, Angles] = {}
        self._refreshed = -np.inf
        gui = server.gui
        self._numbers = gui.add_html('')
        self._calibration = gui.add_html('', visible=False)
        self._playback = PlaybackControls(gui, source.playhead) if source.playhead else None
        self.compared = gui.add_checkbox(
            'Side by side', False,
            hint='A second hand beside it, from the same markers without any constraint',
            visible=source.beside is None)
        picture = gui.add_button('Save PNG')
        picture.on_click(_save_picture)
        # A separate panel, which is folded on phones.
        switches = gui.add_panel()
        with switches.add_tab('Constraints'):
            self._switches = {}
            for name, constraint in CONSTRAINTS.items():
                switch = self._switches[name] = gui.add_checkbox(
                    name, name in source.constraints, hint=constraint.about)
                switch.on_update(partial(self._switch, name))
        with switches.add_tab('Show'):
            self.skin = gui.add_checkbox('Skin', has_skin, disabled=not has_skin)
            self.skeleton = gui.add_checkbox('Skeleton', True, disabled=not has_skin)
            self.markers = gui.add_checkbox('Markers', True)
            self.held = gui.add_checkbox(
                'Hold the wrist', True, hint='The fingers move, the hand stays where it is')
        switches.dock_below(gui.main_panel)

    async def _switch(self, name: str, event: Any) -> None:
        # async runs in viser's thread at once; a later call would see `refresh` undo the switch.
        if event.client is not None:
            change = self._source.constraints.union if event.target.value \
                else self._source.constraints.difference
            self._source.constrain(change({name}))

    def _undo_refused_switches(self) -> None:
        for name, switch in self._switches.items():
            if switch.value != (name in self._source.constraints):
                switch.value = not switch.value

    def refresh(self, state: HandState) -> None:
        """Show the numbers of a frame, at most every `REFRESH_PERIOD`."""
        now = time.monotonic()
        if now - self._refreshed < REFRESH_PERIOD:
            return
        self._refreshed = now
        self._undo_refused_switches()
        self._numbers.content = numbers(self._source.numbers(state), state)
        progress = self._source.calibration()
        self._calibration.visible = progress is not None
        if progress is not None:
            self._calibration.content = coverage_bars(*progress)
        self._show_angles(angle_bars(state.angles, self._source.hand.limits))
        if self._playback is not None:
            self._playback.refresh(now)

    def _show_angles(self, page: str) -> None:
        """Show the angles in each browser."""
        clients = self._server.get_clients()
        for gone in self._angles.keys() - clients.keys():
            del self._angles[gone]
        for number, client in clients.items():
            if number not in self._angles:
                self._angles[number] = Angles(client.gui)
            self._angles[number].show(page, client.camera)


class PlaybackControls:
    """Playback controls: position, if known, speed and pause.

    Parameters
    ----------
    gui : viser.GuiApi
    head : Playhead or Player
    """

    def __init__(self, gui: 'GuiApi', head: Any) -> None:
        self._head, self._scrubbed = head, -np.inf
        self._folder = gui.add_folder(None, visible=head.there)
        with self._folder:
            self._time = None
            if head.duration is not None:
                self._time = gui.add_slider('Time [s]', 0., round(head.duration, 2), .01, 0.)
                self._time.on_update(self._scrub)
            speed = gui.add_dropdown('Speed', tuple(SPEEDS), initial_value='1 ×')
            speed.on_update(lambda event: head.set_rate(SPEEDS[event.target.value]))
            self._play = gui.add_button(PAUSE_LABEL)
            self._play.on_click(self._toggle)

    async def _scrub(self, event: Any) -> None:
        # async as `_switch`; changes by the program have no client.
        if event.client is not None:
            self._scrubbed = time.monotonic()
            self._head.seek(event.target.value)

    def _toggle(self, event: Any) -> None:
        self._head.toggle()
        self._show_playing()

    def _show_playing(self) -> None:
        label = PAUSE_LABEL if self._head.playing else PLAY_LABEL
        if self._play.label != label:
            self._play.label = label

    def refresh(self, now: float) -> None:
        """Show the playback position; `now` is the monotonic time [s]."""
        if self._folder.visible != self._head.there:
            self._folder.visible = self._head.there
        self._show_playing()
        if self._time is not None and now - self._scrubbed > SLIDER_HOLD_TIME:
            self._time.value = round(self._head.now(), 2)


class Angles:
    """Panel with the angles in one browser, left of the hand.

    Parameters
    ----------
    gui : viser.GuiApi
        Of the browser.
    """

    def __init__(self, gui: 'GuiApi') -> None:
        self._panel = gui.add_panel()
        with self._panel.add_tab('Angles'):
            self._bars = gui.add_html('')
        self._panel.dock_left()
        self._panel.set_width(ANGLES_WIDTH)
        self._open = True

    def show(self, page: str, camera: 'CameraHandle') -> None:
        """Show the bars; fold or unfold the panel when the window's size changed."""
        self._bars.content = page
        least = MIN_WIDTH_WITH_ANGLES
        if self._open:
            least -= ANGLES_WIDTH + WIDTH_HYSTERESIS
        has_space = camera.image_width >= least and camera.image_height >= MIN_HEIGHT_WITH_ANGLES
        if has_space != self._open:
            self._open = has_space
            (self._panel.expand if has_space else self._panel.minimize)()


def numbers(texts: dict[str, str], state: HandState) -> str:
    """Return HTML with the live numbers and the count of markers in each state."""
    cells = ''.join(f'<div><div style="opacity:.6">{name}</div><b>{text}</b></div>'
                    for name, text in texts.items())
    counts = Counter(state.marker_states.tolist())
    kinds = '&ensp;'.join(
        f'<span style="color:{MARKER_COLOURS[kind]}">●</span> {counts[kind]} {kind.name.lower()}'
        for kind in MarkerState if counts[kind])
    return (f'<div style="{NUMBERS_STYLE}">'
            '<div style="display:grid;grid-template-columns:repeat(3,auto)">'
            f'{cells}</div>{kinds}</div>')


def _save_picture(event: Any) -> None:
    """Render the view in the browser and download it there as a PNG."""
    camera = event.client.camera
    scale = PNG_SIZE / max(camera.image_height, camera.image_width)
    drawn = event.client.get_render(
        round(scale * camera.image_height), round(scale * camera.image_width),
        transport_format='png', timeout=RENDER_TIMEOUT)
    file = io.BytesIO()
    Image.fromarray(drawn).save(file, 'PNG')
    event.client.send_file_download('hand.png', file.getvalue(), save_immediately=True)
