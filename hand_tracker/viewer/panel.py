"""The panel of the viewer: numbers, playback, what is shown, constraints, angles."""

import io
import time
from collections import Counter
from functools import partial

import numpy as np
from PIL import Image

from ..core.constraints import CONSTRAINTS
from ..core.model.states import MarkerState
from ..drawing.palette import MARKER_COLOURS
from .angle_bars import angle_bars

SPEEDS = {'0.1 ×': .1, '0.25 ×': .25, '0.5 ×': .5, '1 ×': 1., '2 ×': 2.}
PAUSE, PLAY = 'Pause', 'Play'
TOLD_EVERY = .1     # [s] between two updates of numbers, bars and slider
HANDS_OFF = .5      # [s] in which the slider is left to whoever moves it
PNG_SIZE = 1600     # [pixels] of the longer edge, whatever the screen
ANGLES_WIDTH = 260  # [pixels]
WIDE, HIGH = 720, 450   # [pixels] of a picture that has room for the angles at its side
SLACK = 60          # [pixels] by which it may shrink before they go
PATIENCE = 20.      # [s] for a browser to draw its picture
FONT = ('padding:6px 12px;font:12px/1.5 system-ui,sans-serif;'
        'font-variant-numeric:tabular-nums')


class Panel:
    """What a person sees and turns besides the hand.

    Parameters
    ----------
    server : viser.ViserServer
    source : Recording or Live
    has_skin : bool
    """

    def __init__(self, server, source, has_skin):
        self._server, self._source = server, source
        self._angles = {}
        self._told = -np.inf
        gui = server.gui
        self._numbers = gui.add_html('')
        self._playback = Playback(gui, source.playhead) if source.playhead else None
        self.compared = gui.add_checkbox(
            'Side by side', False,
            hint='A second hand beside it, from the same markers without any constraint')
        picture = gui.add_button('Save PNG')
        picture.on_click(save_picture)
        # A panel of its own: on a phone it is folded until somebody asks for it.
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

    async def _switch(self, name, event):
        # In viser's own thread, at once: `tell` would take a switch that has no effect yet back.
        if event.client is not None:
            change = self._source.constraints.union if event.target.value \
                else self._source.constraints.difference
            self._source.constrain(change({name}))

    def _show_refused(self):
        for name, switch in self._switches.items():
            if switch.value != (name in self._source.constraints):
                switch.value = not switch.value

    def tell(self, state):
        """Show the numbers of a frame, when it is time."""
        now = time.monotonic()
        if now - self._told < TOLD_EVERY:
            return
        self._told = now
        self._show_refused()
        self._numbers.content = numbers(self._source.numbers(state), state)
        self._show_angles(angle_bars(state.angles, self._source.hand.limits))
        if self._playback is not None:
            self._playback.tell(now)

    def _show_angles(self, page):
        """Show the angles in each browser, in a panel that is open where it has room for them."""
        clients = self._server.get_clients()
        for gone in self._angles.keys() - clients.keys():
            del self._angles[gone]
        for number, client in clients.items():
            if number not in self._angles:
                self._angles[number] = Angles(client.gui)
            self._angles[number].show(page, client.camera)


class Playback:
    """What steers a playhead: its place, where it knows that, its speed, pause.

    Parameters
    ----------
    gui : viser.GuiApi
    head : Playhead or Player
    """

    def __init__(self, gui, head):
        self._head, self._scrubbed = head, -np.inf
        self._folder = gui.add_folder(None, visible=head.there)
        with self._folder:
            self._time = None
            if head.duration is not None:
                self._time = gui.add_slider('Time [s]', 0., round(head.duration, 2), .01, 0.)
                self._time.on_update(self._scrub)
            speed = gui.add_dropdown('Speed', tuple(SPEEDS), initial_value='1 ×')
            speed.on_update(lambda event: head.set_rate(SPEEDS[event.target.value]))
            self._play = gui.add_button(PAUSE)
            self._play.on_click(self._toggle)

    async def _scrub(self, event):
        # As `_switch`. What this program itself sets has no client.
        if event.client is not None:
            self._scrubbed = time.monotonic()
            self._head.seek(event.target.value)

    def _toggle(self, event):
        self._head.toggle()
        self._show_playing()

    def _show_playing(self):
        label = PAUSE if self._head.playing else PLAY
        if self._play.label != label:
            self._play.label = label

    def tell(self, now):
        """Show where the playhead is now [s of the monotonic clock]."""
        if self._folder.visible != self._head.there:
            self._folder.visible = self._head.there
        self._show_playing()
        if self._time is not None and now - self._scrubbed > HANDS_OFF:
            self._time.value = round(self._head.now(), 2)


class Angles:
    """A panel of a browser with the angles, at the left of the hand.

    Parameters
    ----------
    gui : viser.GuiApi
        Of the browser.
    """

    def __init__(self, gui):
        self._panel = gui.add_panel()
        with self._panel.add_tab('Angles'):
            self._bars = gui.add_html('')
        self._panel.dock_left()
        self._panel.set_width(ANGLES_WIDTH)
        self._open = True

    def show(self, page, camera):
        """Show bars, and fold or unfold the panel where the room that a camera has changed."""
        self._bars.content = page
        least = WIDE - ANGLES_WIDTH - SLACK if self._open else WIDE
        room = camera.image_width >= least and camera.image_height >= HIGH
        if room != self._open:
            self._open = room
            (self._panel.expand if room else self._panel.minimize)()


def numbers(texts, state):
    """Return a page's part with the live numbers, and how many markers are in which state."""
    cells = ''.join(f'<div><div style="opacity:.6">{name}</div><b>{text}</b></div>'
                    for name, text in texts.items())
    counts = Counter(state.marker_states.tolist())
    kinds = '&ensp;'.join(
        f'<span style="color:{MARKER_COLOURS[kind]}">●</span> {counts[kind]} {kind.name.lower()}'
        for kind in MarkerState if counts[kind])
    return (f'<div style="{FONT}"><div style="display:grid;grid-template-columns:repeat(3,auto)">'
            f'{cells}</div>{kinds}</div>')


def save_picture(event):
    """Have the browser that asks draw its view, and give it to it as a PNG."""
    camera = event.client.camera
    scale = PNG_SIZE / max(camera.image_height, camera.image_width)
    drawn = event.client.get_render(
        round(scale * camera.image_height), round(scale * camera.image_width),
        transport_format='png', timeout=PATIENCE)
    file = io.BytesIO()
    Image.fromarray(drawn).save(file, 'PNG')
    event.client.send_file_download('hand.png', file.getvalue(), save_immediately=True)
