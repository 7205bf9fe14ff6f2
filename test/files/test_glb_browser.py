"""A GLB of a tracked hand in three.js, in a real browser: docs/glb.html draws its skin in motion.

Nothing is installed or fetched here: three.js is that which trimesh's viewer has in it.
"""

import re
import subprocess
import sys
import zipfile
from importlib.resources import files

import numpy as np
import pytest
from playwright import sync_api

from benchmarks.repository import REPOSITORY
from docs.viewer_pictures import BROWSER, SOFTWARE
from hand_tracker.files.bags import write_bag
from hand_tracker.simulation.packaged_recordings import demo_recording, recording_messages

NEEDS = 'playwright', 'skimage', 'trimesh'
FRAMES, RATE = 300, 120.
OPEN, FIST = .2, 2.2    # [s] of the recording
VERTICES_APART = 40
PAGE_PATIENCE = 60_000  # [ms]

pytestmark = pytest.mark.skipif(BROWSER is None, reason='no Chromium is installed')

# Every so many vertices of the skin, as its bones are in the last frame that was drawn.
BENDING_SCRIPT = """
globalThis.bent = (skin, step) => {
  const place = skin.geometry.attributes.position, found = [];
  for (let i = 0; i < place.count; i += step) {
    const at = new THREE.Vector3().fromBufferAttribute(place, i);
    (skin.applyBoneTransform ?? skin.boneTransform).call(skin, i, at);
    found.push(at);
  }
  return found;
};
// Which three.js has from r151 on.
THREE.SkinnedMesh.prototype.computeBoundingBox ??= function () {
  this.boundingBox = new THREE.Box3().setFromPoints(bent(this, 1));
};"""
SKINNED_SCRIPT = """step => {
  const skin = hand.scene.getObjectByProperty('isSkinnedMesh', true);
  return bent(skin, step).map(at => at.applyMatrix4(skin.matrixWorld).toArray());
}"""


def three_js():
    """Return the script of three.js and its GLTF loader in trimesh's viewer, or None."""
    packed = files('trimesh') / 'resources' / 'templates' / 'viewer.zip'
    if not packed.is_file():
        return None
    with packed.open('rb') as file, zipfile.ZipFile(file) as archive:
        page = archive.read(archive.namelist()[0]).decode()
    library, found, _ = page.partition('var camera,controls,scene')
    return library.rpartition('<script>')[2] if found and 'THREE.GLTFLoader=' in library else None


def modules(library, page):
    """Return the modules that a page imports, by their addresses' ends, made of a script."""
    used = sorted(set(re.findall(r'\bTHREE\.(\w+)', page)))
    names = '\n'.join(f'export const {name} = globalThis.THREE.{name};' for name in used)
    return {'three.module.js': f'{library}\n{BENDING_SCRIPT}\n{names}', 'GLTFLoader.js': '''
        import 'three';
        const Own = globalThis.THREE.GLTFLoader;
        export class GLTFLoader extends Own {
          async loadAsync(address) { return globalThis.hand = await super.loadAsync(address); }
        }'''}


@pytest.fixture(scope='module')
def glb(tmp_path_factory):
    folder, demo = tmp_path_factory.mktemp('glb'), demo_recording(rate=RATE)
    write_bag(folder / 'take.mcap', recording_messages(demo._replace(
        stamps=demo.stamps[:FRAMES], markers=demo.markers[:FRAMES], angles=demo.angles[:FRAMES]),
        'right'))
    subprocess.run([sys.executable, '-m', 'hand_tracker', 'track', str(folder / 'take.mcap'), '-o',
                    str(folder / 'hand.glb')], check=True)
    return folder / 'hand.glb'


def test_three_js_moves_the_skin(glb):
    library = three_js()
    if library is None:
        pytest.skip("trimesh's viewer has no three.js of the known form")
    html = (REPOSITORY / 'docs' / 'glb.html').read_text(encoding='utf-8')
    scripts = modules(library, html)

    def answer(route):
        name = route.request.url.partition('?')[0].rpartition('/')[2]
        if name in scripts:
            route.fulfill(body=scripts[name], content_type='text/javascript')
        elif name == glb.name:
            route.fulfill(path=glb)
        else:
            route.fulfill(body=html, content_type='text/html')

    skins, pictures, errors = [], [], []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=SOFTWARE)
        page = browser.new_page(viewport={'width': 400, 'height': 300})
        page.route('**/*', answer)
        page.on('pageerror', lambda error: errors.append(str(error)))
        for time in (OPEN, FIST):
            page.goto(f'http://page/glb.html?file={glb.name}&time={time}')
            try:
                page.wait_for_function("document.title == 'drawn'", timeout=PAGE_PATIENCE)
            except sync_api.TimeoutError:
                raise AssertionError(f'nothing drawn: {errors}') from None
            skins.append(np.array(page.evaluate(SKINNED_SCRIPT, VERTICES_APART)))
            pictures.append(page.screenshot())
        browser.close()
    assert errors == []
    spread, bent = (skin - skin.mean(axis=0) for skin in skins)
    assert np.isfinite(skins).all() and len(spread) > 20
    # An open hand is as long as a hand; the tips of a fist are nearer.
    lengths = [np.linalg.norm(one[:, None] - one, axis=2).max() for one in (spread, bent)]
    assert .15 < lengths[0] < .25 and lengths[1] < .8 * lengths[0]
    assert pictures[0] != pictures[1]
