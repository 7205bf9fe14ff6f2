"""The scene of the viewer: skin, skeleton and markers of one hand, and the light on them."""

from collections import deque

import numpy as np

from ..core.model.kinematics import Pose
from ..core.model.marker_layout import MARKERS
from ..core.model.states import MarkerState, PalmState
from ..core.numerics.quaternion import quaternion
from ..drawing.palette import MARKER_COLOURS, rgb
from .skeleton_mesh import skeleton_mesh

SKIN_COLOUR, BONE_COLOUR = (255, 158, 104), (240, 240, 235)
COLOURS = {int(kind): tuple(round(255. * share) for share in rgb(colour))
           for kind, colour in MARKER_COLOURS.items()}
GROUND = 21, 28, 38      # the dark cards of the README
MARKER_RADIUS = .006     # [m]
SEEN_THROUGH = .48       # opacity of each wall of a skin that shows what is inside,
FADED = .25              # and of a hand whose palm is not found
INFLUENCES = 4           # bones that the browser lets move a vertex at most
FLOOR = -.10             # [m] below the wrist
EYE = np.array((-.20, 0., .37))   # [m] from the wrist: above the hand, a little behind it
LOOK_AT = np.array((.076, 0., 0.))
FIELD_OF_VIEW = np.radians(35.)
HAND_WIDTH, HAND_LENGTH = .19, .255   # [m] that are seen at least
CAPTION_AT = -.03, 0., 0.
REMEMBERED = 16          # places of a camera
APART = .18              # [m] between two hands
ROAM = .03               # [m] that a hand whose wrist is not held goes from the middle at most
PHONE, PHONE_FREE = .7, .6   # width by height of a phone, and the share above its panel


class Framing:
    """What keeps the hands in a browser's picture, until a person moves the camera.

    Parameters
    ----------
    camera : viser.CameraHandle
    hands : int
    """

    def __init__(self, camera, hands):
        self._camera = camera
        # What a browser sends while it is told of a place is still an earlier one.
        self._placed = deque(maxlen=REMEMBERED)
        self.frame(hands)
        camera.on_update(self._on_update)

    def frame(self, hands):
        """Look at one or two hands."""
        self._hands, self._aspect = hands, self._camera.aspect
        place_camera(self._camera, hands, self._aspect)
        self._placed.append(self._camera.position)

    def _on_update(self, camera):
        if camera.aspect != self._aspect and any(
                np.allclose(camera.position, place, atol=1e-4) for place in self._placed):
            self.frame(self._hands)


class HandScene:
    """One hand in the scene.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
        Of its node, as '/hand'.
    hand : Hand
    skin : Skin or None
        None where there is none: the skeleton stands alone.
    """

    def __init__(self, scene, name, hand, skin):
        self._node = scene.add_frame(name, show_axes=False)
        self._skin = skin and Mesh(scene, f'{name}/skin', skin, SKIN_COLOUR)
        self._bones = Mesh(scene, f'{name}/bones', skeleton_mesh(hand), BONE_COLOUR)
        self._markers = [scene.add_icosphere(f'{name}/markers/{marker}', MARKER_RADIUS,
                                             receive_shadow=False)
                         for marker in MARKERS]
        self._kinds = [None] * len(MARKERS)
        self._caption = scene.add_label(f'{name}/caption', '', position=CAPTION_AT,
                                        anchor='top-center', visible=False,
                                        font_screen_scale=1.3)
        self.show(skin=True, skeleton=True, markers=True)

    def show(self, skin, skeleton, markers):
        """Choose what is shown; without a skin the skeleton always is."""
        if self._skin is not None:
            self._skin.node.visible = skin
        self._bones.node.visible = skeleton or self._skin is None
        self._show_markers = markers

    @property
    def visible(self):
        """Whether anything of it is shown."""
        return self._node.visible

    @visible.setter
    def visible(self, visible):
        self._node.visible = visible

    def caption(self, text):
        """Write a line under the hand; none if it is empty."""
        self._caption.visible = bool(text)
        if text:
            self._caption.text = text

    def draw(self, state, anchor, beside=0.):
        """Show a hand.

        Parameters
        ----------
        state : HandState
        anchor : Pose
            Of the wrist, at which the scene has its origin.
        beside : float, optional
            To be drawn so far to the left [m].
        """
        turned, at = anchor.rotation.T, state.wrist_position - anchor.position
        self._node.wxyz = _wxyz(turned @ state.wrist_rotation)
        self._node.position = turned @ at + (0., beside, 0.)
        local = in_wrist(state)
        found = state.palm <= PalmState.CARRIED
        if self._skin is not None:
            inside = self._bones.node.visible or self._show_markers
            self._skin.move(local, SEEN_THROUGH if inside and found else 1. if found else FADED)
        self._bones.move(local, 1. if found else FADED)
        places = (state.markers - state.wrist_position) @ state.wrist_rotation
        for i, (marker, place, kind) in enumerate(zip(self._markers, places, state.marker_states)):
            marker.position = place
            if kind != self._kinds[i]:
                self._kinds[i] = kind
                marker.color = COLOURS[kind]
            marker.visible = self._show_markers and kind != MarkerState.ABSENT


class Mesh:
    """A mesh in the scene that follows the links.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
    skin : Skin
    colour : tuple of int
        Red, green, blue, 0 to 255.
    """

    def __init__(self, scene, name, skin, colour):
        self._links = skin.links
        self.node = scene.add_mesh_skinned(
            name, skin.vertices, skin.faces, skin_weights=strongest(skin.weights), color=colour,
            # The far wall behind what is inside lets the near one be clear.
            side='double', receive_shadow=False,
            bone_wxyzs=np.array([_wxyz(rotation) for rotation in skin.rest.rotation]),
            bone_positions=skin.rest.position)

    def move(self, pose, opacity):
        """Follow the 25 links, when it is visible."""
        if not self.node.visible:
            return
        for bone, link in zip(self.node.bones, self._links):
            bone.wxyz = _wxyz(pose.rotation[link])
            bone.position = pose.position[link]
        opacity = None if opacity == 1. else opacity
        if self.node.opacity != opacity:
            self.node.opacity = opacity


def strongest(weights):
    """Return weights of which each row has its greatest few alone, and sums to 1."""
    least = np.sort(weights, axis=1)[:, -INFLUENCES, None]
    kept = np.where(weights >= least, weights, 0.)
    return kept / kept.sum(axis=1, keepdims=True)


def wrist_pose(state):
    """Return the wrist's pose of a state."""
    return Pose(state.wrist_rotation, state.wrist_position)


def kept_near(anchor, state):
    """Return an anchor from which the wrist is not far, turned as before: nothing leaves the view.

    Parameters
    ----------
    anchor : Pose
        As of `HandScene.draw`.
    state : HandState

    Returns
    -------
    Pose
    """
    off = state.wrist_position - anchor.position
    share = ROAM / max(np.linalg.norm(off), ROAM)
    return anchor._replace(position=state.wrist_position - share * off)


def in_wrist(state):
    """Return the links' frames in that of the wrist."""
    back = state.wrist_rotation.T
    return Pose(back @ state.pose.rotation,
                (state.pose.position - state.wrist_position) @ state.wrist_rotation)


def _wxyz(rotation):
    x, y, z, w = quaternion(rotation.tolist())
    return w, x, y, z


def light(scene):
    """Light the scene from the side, so that fingers look round; put a floor under the hand."""
    scene.set_background_image(np.full((2, 2, 3), GROUND, dtype=np.uint8), format='png')
    # The surroundings that viser reflects by default light all sides alike.
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere('/light/sky', sky_color=(255, 250, 244),
                               ground_color=(120, 110, 130), intensity=1.)
    scene.add_light_directional('/light/key', intensity=3., position=(.2, .8, .6),
                                cast_shadow=True)
    scene.add_light_directional('/light/rim', color=(190, 215, 255), intensity=1.2,
                                position=(-.2, -.9, .35))
    scene.add_grid('/floor', plane='xy', infinite_grid=True, position=(0., 0., FLOOR),
                   cell_size=.02, section_size=.1, cell_color=(34, 43, 56),
                   section_color=(46, 57, 73), fade_distance=1.5, shadow_opacity=.3)


def place_camera(camera, hands, aspect):
    """Look at one or two hands from above.

    Parameters
    ----------
    camera : viser.CameraHandle
    hands : int
    aspect : float
        Width of the picture by its height.
    """
    height = 2. * np.linalg.norm(EYE) * np.tan(.5 * FIELD_OF_VIEW)
    # On a phone the panel covers the lower part of the picture.
    free = PHONE_FREE if aspect < PHONE else 1.
    away = max(HAND_LENGTH / free, (HAND_WIDTH + (hands - 1) * APART) / aspect) / height
    at = LOOK_AT - (.5 * (1. - free) * away * height, 0., 0.)
    camera.fov = FIELD_OF_VIEW
    # A camera that moves takes along what it looks at.
    camera.position = at + away * EYE
    camera.look_at = at
