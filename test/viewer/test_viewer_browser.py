"""The viewer in a real browser: pixels, playback, switches, the PNG, a phone.

Nothing is installed here: without playwright, a Chromium or viser the tests are skipped.
"""

import io
import re
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest
from helpers.ros_process import PATIENCE, Process
from PIL import Image
from playwright import sync_api

from docs.viewer_pictures import BROWSER, SETTLED_MS, SOFTWARE
from hand_tracker.cli.view import warm_up
from hand_tracker.package_data import packaged_recording

NEEDS = 'playwright', 'skimage', 'viser'

pytestmark = pytest.mark.skipif(BROWSER is None, reason='no Chromium is installed')

DESKTOP, PHONE = (1100, 500), (390, 844)
LYING, SMALL = (844, 390), (700, 500)
HAND = 2000         # [pixels] that are skin, at least
MARKER_PIXELS = 500  # [pixels] that are markers that are seen, at least
MOVED = .003        # share of the pixels that change when a finger moves
VISIBLE_CHANGE = 12  # [0 to 255] by which a changed pixel changes
NARROW = 20         # [pixels] between the parts of one hand
FIST = '2'          # [s] of the recording: all fingers are bent


@pytest.fixture(scope='module')
def address():
    # What is compiled here for the first time is not what is waited for below.
    warm_up()
    with Process([sys.executable, '-m', 'hand_tracker', 'view', str(packaged_recording()),
                  '--port', '8300']) as viewer:
        viewer.wait_for_line('http://', PATIENCE)
        yield re.search(r'http://\S+', viewer.output).group()
        assert not viewer.ended, viewer.output
        assert viewer.interrupt() == 0
        assert 'Traceback' not in viewer.output


@pytest.fixture(scope='module')
def browser():
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=SOFTWARE)
        yield browser
        browser.close()


class Page:
    """The viewer's page once the hand is there."""

    def __init__(self, browser, address, size, **more):
        self.page = browser.new_page(
            viewport={'width': size[0], 'height': size[1]}, accept_downloads=True, **more)
        self.page.set_default_timeout(1e3 * PATIENCE)
        self.errors = []
        self.page.on('pageerror', lambda error: self.errors.append(str(error)))
        self.page.on('console', lambda message: self.errors.append(message.text)
                     if message.type == 'error' else None)
        self.page.goto(address)
        # That the browser draws by software: it hides fingers.
        self.page.locator('.mantine-Notification-closeButton').click()
        self.until(lambda: is_skin(self.picture()).sum() > HAND, 'a hand')

    def picture(self):
        """Return what the scene shows, as it is on the screen."""
        box = self.page.locator('canvas').last.bounding_box()
        return pixels(self.page.screenshot(clip=box))

    def settled(self):
        """Return the picture when it no longer changes."""
        found = [self.picture()]

        def still():
            found.append(self.picture())
            return changed(*found[-2:]) < .1 * MOVED

        self.until(still, 'a still picture')
        return found[-1]

    def until(self, condition, what):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'no {what} in {PATIENCE:g} s; {self.errors}'

    def pause_at(self, seconds):
        self.page.get_by_text('Pause', exact=True).click()
        self.page.get_by_text('Play', exact=True).wait_for()
        # The last place that was played may still be on its way, and would replace this one.
        self.page.wait_for_timeout(SETTLED_MS)
        time_box = self.page.get_by_role('textbox').first
        time_box.fill(seconds)
        time_box.press('Enter')

    def angle(self, joint):
        """Return an angle of the index finger as the panel tells it [degrees]."""
        row = self.page.locator('section div', has_text=joint).first
        return int(re.search(r'(-?\d+)°', row.inner_text()).group(1))


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert('RGB')).astype(int)


def is_skin(picture):
    red, green, blue = np.moveaxis(picture, -1, 0)
    return (red > 100) & (red - green > 8) & (green > blue) & (abs(red - blue - 72) < 58)


def is_seen_marker(picture):
    red, green, blue = np.moveaxis(picture, -1, 0)
    return green - np.maximum(red, blue) > 30


def changed(first, second):
    # The panel opens after the scene and takes some of its width.
    if first.shape != second.shape:
        return np.nan
    return (np.abs(first - second).max(axis=-1) > VISIBLE_CHANGE).mean()


@contextmanager
def opened(browser, address, size, **more):
    """Yield a page that has no error; then close it, as the others are drawn by software too."""
    page = Page(browser, address, size, **more)
    yield page
    page.page.close()
    assert page.errors == []


@pytest.fixture(scope='module')
def desktop(address, browser):
    with opened(browser, address, DESKTOP) as page:
        yield page


@pytest.fixture(scope='module')
def phone(address, browser):
    with opened(browser, address, PHONE, is_mobile=True, has_touch=True) as page:
        yield page


def test_the_hand_moves_while_the_recording_plays(desktop):
    desktop.until(lambda: changed(desktop.picture(), desktop.picture()) > MOVED, 'motion')


def test_markers_show_through_the_skin(desktop):
    desktop.until(lambda: is_seen_marker(desktop.picture()).sum() > MARKER_PIXELS, 'markers')


def test_a_paused_hand_stands_still_where_it_was_sent(desktop):
    desktop.pause_at(FIST)
    desktop.until(lambda: desktop.angle('PIP flexion') > 40, 'fist')
    settled = desktop.settled()
    assert is_skin(settled).sum() > HAND
    assert changed(settled, desktop.picture()) < .1 * MOVED


def test_a_constraint_switch_changes_the_pose_and_back(desktop):
    switch = desktop.page.get_by_label('DIP coupling', exact=True)
    desktop.until(lambda: desktop.angle('DIP flexion') > 10, 'bent last joint')
    switch.click()
    desktop.until(lambda: desktop.angle('DIP flexion') == 0, 'straight last joint')
    straight = desktop.settled()
    switch.click()
    desktop.until(lambda: desktop.angle('DIP flexion') > 10, 'bent last joint again')
    desktop.until(lambda: changed(straight, desktop.picture()) > MOVED, 'changed pose')


def test_the_button_saves_a_picture_of_the_hand(desktop, tmp_path):
    with desktop.page.expect_download() as download:
        desktop.page.get_by_text('Save PNG', exact=True).click()
    assert download.value.suggested_filename == 'hand.png'
    download.value.save_as(tmp_path / 'hand.png')
    data = (tmp_path / 'hand.png').read_bytes()
    assert data.startswith(b'\x89PNG')
    assert is_skin(pixels(data)).sum() > HAND


def test_comparison_shows_a_second_hand(desktop):
    def gap():
        """Return the widest gap between columns with skin, NaN where there is none [pixels]."""
        gaps = np.diff(np.flatnonzero(is_skin(desktop.picture()).any(axis=0)))
        return gaps.max() if len(gaps) else np.nan  # for a moment while hands are added

    assert gap() < NARROW
    desktop.page.get_by_label('Side by side', exact=True).click()
    desktop.until(lambda: gap() > 2 * NARROW, 'second hand')
    desktop.page.get_by_label('Side by side', exact=True).click()
    desktop.until(lambda: gap() < NARROW, 'single hand')


def test_a_phone_shows_the_whole_hand_above_the_panel(phone):
    def top():
        """Return where the panel begins [pixels]."""
        return phone.page.get_by_text('hand_tracker', exact=True).bounding_box()['y']

    phone.until(lambda: top() > .55 * PHONE[1], 'folded panel')
    assert is_skin(phone.picture()[:int(top())]).sum() > HAND
    assert not phone.page.get_by_label('Rigidity', exact=True).is_visible()
    phone.page.get_by_text('Constraints', exact=False).click()
    phone.until(phone.page.get_by_label('Rigidity', exact=True).is_visible, 'switch')


def shows_the_whole_hand(page):
    """Return whether there is a hand in the picture, and none of it at an edge."""
    skin = is_skin(page.picture())
    rows, columns = np.flatnonzero(skin.any(axis=1)), np.flatnonzero(skin.any(axis=0))
    return skin.sum() > HAND and rows[0] > 0 and columns[0] > 0 \
        and rows[-1] < skin.shape[0] - 1 and columns[-1] < skin.shape[1] - 1


def test_a_small_window_shows_the_whole_hand(desktop):
    desktop.page.set_viewport_size({'width': SMALL[0], 'height': SMALL[1]})
    desktop.until(lambda: shows_the_whole_hand(desktop), 'whole hand')


def test_a_phone_that_is_turned_shows_the_whole_hand(phone):
    phone.page.set_viewport_size({'width': LYING[0], 'height': LYING[1]})
    phone.until(lambda: shows_the_whole_hand(phone), 'whole hand')
