"""Take pictures of the viewer's page: `python -m docs.viewer`. Needs playwright and Chromium."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

from hand_tracker.package_data import packaged_recording

FOLDER = Path(__file__).resolve().parent / 'pictures'
BROWSER = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))),
               None)
SOFTWARE = ('--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader')
SIZE = {'width': 1280, 'height': 720}
HIDDEN = '16.2'                 # [s] of the recording: a marker is hidden
PATIENCE, SETTLED, DRAWN = 120e3, 2e3, 8e3    # [ms]


def photograph(address):
    """Save how the page looks with a hand, and with a second one beside it."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=SOFTWARE)
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(PATIENCE)
        page.goto(address)
        # That the browser draws by software: it hides fingers.
        page.locator('.mantine-Notification-closeButton').click()
        page.get_by_text('Pause', exact=True).click()
        page.get_by_text('Play', exact=True).wait_for()
        # The last place that was played may still be on its way.
        page.wait_for_timeout(SETTLED)
        time = page.get_by_role('textbox').first
        time.fill(HIDDEN)
        time.press('Enter')
        page.wait_for_timeout(DRAWN)
        page.screenshot(path=FOLDER / 'viewer.png')
        page.get_by_label('Side by side', exact=True).click()
        page.mouse.move(SIZE['width'] // 2, SIZE['height'] // 2)
        page.wait_for_timeout(DRAWN)
        page.screenshot(path=FOLDER / 'viewer_comparison.png')
        browser.close()


def main():
    """Serve the packaged recording, and photograph the page."""
    command = [sys.executable, '-m', 'hand_tracker', 'view', packaged_recording()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as viewer:
        try:
            photograph(re.search(r'http://\S+', viewer.stdout.readline()).group())
        finally:
            viewer.terminate()
            viewer.wait()


if __name__ == '__main__':
    main()
