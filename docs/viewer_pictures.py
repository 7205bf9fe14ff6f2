"""Take pictures of the viewer's page: `python -m docs.viewer_pictures [NAME ...]`.

`recording` and `calibration`; needs playwright and Chromium, and rclpy for the second.
"""

import re
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from playwright.sync_api import sync_playwright

from benchmarks.repository import PICTURE_FOLDER
from hand_tracker.package_data import packaged_recording

BROWSER = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))),
               None)
SOFTWARE = ('--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader')
SIZE = {'width': 1280, 'height': 720}
SIZE_WITH_BARS = {'width': 1280, 'height': 860}
HIDDEN_AT = '16.2'              # [s] of the recording: a marker is hidden
PATIENCE_MS, SETTLED_MS, DRAWN_MS = 120e3, 2e3, 8e3  # [ms]
SHOWN_MOVEMENTS = 6             # of twelve, at which a calibration is photographed
COLOURS = 256                   # of a picture
PACE = 60.                      # [Hz] of the simulated markers: the browser draws by software


def photograph(address):
    """Save how the page looks with a hand, and with a second one beside it."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=SOFTWARE)
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(PATIENCE_MS)
        page.goto(address)
        # That the browser draws by software: it hides fingers.
        page.locator('.mantine-Notification-closeButton').click()
        page.get_by_text('Pause', exact=True).click()
        page.get_by_text('Play', exact=True).wait_for()
        # The last place that was played may still be on its way.
        page.wait_for_timeout(SETTLED_MS)
        time = page.get_by_role('textbox').first
        time.fill(HIDDEN_AT)
        time.press('Enter')
        page.wait_for_timeout(DRAWN_MS)
        page.screenshot(path=PICTURE_FOLDER / 'viewer.png')
        page.get_by_label('Side by side', exact=True).click()
        page.mouse.move(SIZE['width'] // 2, SIZE['height'] // 2)
        page.wait_for_timeout(DRAWN_MS)
        page.screenshot(path=PICTURE_FOLDER / 'viewer_comparison.png')
        browser.close()


def recording():
    """Serve the packaged recording, and photograph the page."""
    command = [sys.executable, '-m', 'hand_tracker', 'view', packaged_recording()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as viewer:
        try:
            photograph(re.search(r'http://\S+', viewer.stdout.readline()).group())
        finally:
            viewer.terminate()
            viewer.wait()


def calibration():
    """Calibrate the simulated hand live, and photograph the page while its bars fill."""
    with ExitStack() as running:
        folder = running.enter_context(TemporaryDirectory())
        running.enter_context(started('tracker_node'))
        running.enter_context(started('simulate_node', motion='range_of_motion', rate=PACE))
        viewer = running.enter_context(started('viewer_node'))
        address = re.search(r'http://\S+', viewer.stdout.readline()).group()
        browser = running.enter_context(sync_playwright()).chromium.launch(
            executable_path=BROWSER, args=SOFTWARE)
        page = browser.new_page(viewport=SIZE_WITH_BARS)
        page.set_default_timeout(PATIENCE_MS)
        page.goto(address)
        page.locator('.mantine-Notification-closeButton').click()
        page.get_by_text('seen').wait_for()
        page.wait_for_timeout(DRAWN_MS)
        file = Path(folder, 'my_hand.yaml')
        calibrating = running.enter_context(started('calibrate_node', output=file))
        page.locator('.cb .all').nth(SHOWN_MOVEMENTS - 1).wait_for()
        picture = PICTURE_FOLDER / 'viewer_calibration.png'
        page.screenshot(path=picture)
        Image.open(picture).convert('RGB').quantize(COLOURS).save(picture, optimize=True)
        calibrating.wait()
        print(f'{picture}; {file.stat().st_size} bytes of the hand that was fitted')
        browser.close()


class started(subprocess.Popen):
    """A node of this package as a process, ended at the end of a `with`."""

    def __init__(self, module, **parameters):
        given = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
        super().__init__([sys.executable, '-m', f'hand_tracker.nodes.{module}', '--ros-args',
                          *given], stdout=subprocess.PIPE, text=True)

    def __exit__(self, *error):
        self.terminate()
        super().__exit__(*error)


if __name__ == '__main__':
    for name in sys.argv[1:] or ('recording', 'calibration'):
        {'recording': recording, 'calibration': calibration}[name]()
