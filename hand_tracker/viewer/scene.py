"""3D scene of the viewer: skin, skeleton and markers of a hand, lights and camera."""

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.model.hand import Hand
from ..core.model.kinematics import Pose
from ..core.model.states import MarkerState, PalmState
from ..core.numerics.quaternion import quaternion
from ..core.tracker import HandState
from ..drawing.palette import MARKER_COLOURS, rgb
from ..skin.skinning import Skin
from .skeleton_mesh import skeleton_mesh

if TYPE_CHECKING:
    from viser import CameraHandle, IcosphereHandle, SceneApi

SKIN_RGB, BONE_RGB = (255, 158, 104), (240, 240, 235)
MARKER_RGB = {int(kind): tuple(round(255. * share) for share in rgb(colour))
              for kind, colour in MARKER_COLOURS.items()}
BACKGROUND_RGB = 21, 28, 38      # the dark cards of the README
MARKER_BALL_RADIUS = .006     # [m]
TRANSLUCENT_OPACITY = .48       # of each wall of the skin, with its inside visible
LOST_HAND_OPACITY = .25              # without a tracked palm
BONES_PER_VERTEX = 4           # the most that the browser supports
FLOOR_HEIGHT = -.10             # [m] below the wrist
CAMERA_OFFSET = np.array((-.20, 0., .37))   # [m] from the target
VIEWER_FIELD_OF_VIEW = np.radians(35.)
CAPTION_POSITION = -.03, 0., 0.
CAMERA_HISTORY = 16          # positions
HAND_SPACING = .18              # [m] between the wrists of two hands
MAX_ANCHOR_DISTANCE = .03               # [m] of a moving wrist from the origin
PHONE_ASPECT, PHONE_FREE_SHARE = .7, .6   # width by height, and share above the panel


class Extent(NamedTuple):
    """Space of a hand that is always visible, from the wrist.

    Attributes
    ----------
    near, far : float
        Towards the fingers [m].
    aside : float
        To either side [m].
    """

    near: float
    far: float
    aside: float

    def joined(self, other: 'Extent') -> 'Extent':
        """Return the extent that holds another one too."""
        return Extent(min(self.near, other.near), max(self.far, other.far),
                      max(self.aside, other.aside))


PERSON_EXTENT = Extent(-.0515, .2035, .095)


class Framing:
    """Camera framing of a browser: keeps the hands in view until the user moves the camera.

    Parameters
    ----------
    camera : viser.CameraHandle
    hands : int
    extent : Extent, optional
        Of the largest of them; the person's when left out.
    """

    def __init__(self, camera: 'CameraHandle', hands: int,
                 extent: Extent = PERSON_EXTENT) -> None:
        self._camera, self._extent = camera, extent
        # The browser still reports earlier positions after one was set.
        self._placed: deque = deque(maxlen=CAMERA_HISTORY)
        self.frame(hands)
        camera.on_update(self._on_update)

    def frame(self, hands: int) -> None:
        """Frame one or two hands."""
        self._hands, self._aspect = hands, self._camera.aspect
        place_camera(self._camera, hands, self._aspect, self._extent)
        self._placed.append(self._camera.position)

    def set_extent(self, extent: Extent) -> None:
        """Frame hands of another extent."""
        self._extent = extent
        self.frame(self._hands)

    def _on_update(self, camera: 'CameraHandle') -> None:
        placed = tuple(self._placed)    # another thread may add to them
        if camera.aspect != self._aspect and any(
                np.allclose(camera.position, place, atol=1e-4) for place in placed):
            self.frame(self._hands)


class HandScene:
    """One hand in the scene.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
        Of its node, such as '/hand'.
    hand : Hand
    skin : Skin or None
        None shows the skeleton alone.
    """

    def __init__(self, scene: 'SceneApi', name: str, hand: Hand, skin: Skin | None) -> None:
        self._scene, self._name = scene, name
        self._node = scene.add_frame(name, show_axes=False)
        self._skin = None if skin is None else SceneMesh(scene, f'{name}/skin', skin, SKIN_RGB)
        self._bones = SceneMesh(scene, f'{name}/bones', skeleton_mesh(hand), BONE_RGB)
        self._markers: list[IcosphereHandle] = []    # as many as frames have
        self._kinds: list[MarkerState] = []
        self._caption = scene.add_label(f'{name}/caption', '', position=CAPTION_POSITION,
                                        anchor='top-center', visible=False,
                                        font_screen_scale=1.3)
        self.show(skin=True, skeleton=True, markers=True)

    def show(self, skin: bool, skeleton: bool, markers: bool) -> None:
        """Show or hide skin, skeleton and markers; without a skin the skeleton is always shown."""
        if self._skin is not None:
            self._skin.node.visible = skin
        self._bones.node.visible = skeleton or self._skin is None
        self._show_markers = markers

    def remove(self) -> None:
        """Remove the hand from the scene."""
        self._node.remove()

    @property
    def visible(self) -> bool:
        """Whether the hand is shown."""
        return self._node.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._node.visible = visible

    def caption(self, text: str) -> None:
        """Show a line of text under the hand; hide it if empty."""
        self._caption.visible = bool(text)
        if text:
            self._caption.text = text

    def draw(self, state: HandState, anchor: Pose, offset: float = 0.) -> None:
        """Draw the hand of a frame.

        Parameters
        ----------
        state : HandState
        anchor : Pose
            Origin of the scene, in the frame of the state.
        offset : float, optional
            Shift to the left [m].
        """
        turned, at = anchor.rotation.T, state.wrist_position - anchor.position
        self._node.wxyz = wxyz(turned @ state.wrist_rotation)
        self._node.position = turned @ at + (0., offset, 0.)
        local = _in_wrist(state)
        found = state.palm <= PalmState.CARRIED
        if self._skin is not None:
            inside = self._bones.node.visible or self._show_markers
            self._skin.move(local, LOST_HAND_OPACITY if not found
                            else TRANSLUCENT_OPACITY if inside else 1.)
        self._bones.move(local, 1. if found else LOST_HAND_OPACITY)
        places = (state.markers - state.wrist_position) @ state.wrist_rotation
        for i, (place, kind) in enumerate(zip(places, state.marker_states)):
            if i == len(self._markers):
                self._markers.append(self._scene.add_icosphere(
                    f'{self._name}/markers/{i}', MARKER_BALL_RADIUS, color=MARKER_RGB[kind],
                    receive_shadow=False))
                self._kinds.append(kind)
            marker = self._markers[i]
            marker.position = place
            if kind != self._kinds[i]:
                self._kinds[i] = kind
                marker.color = MARKER_RGB[kind]
            marker.visible = self._show_markers and kind != MarkerState.ABSENT


class SceneMesh:
    """Skinned mesh in the scene, deformed by the browser.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
    skin : Skin
    colour : tuple of int
        Red, green, blue, 0 to 255.
    """

    def __init__(self, scene: 'SceneApi', name: str, skin: Skin,
                 colour: tuple[int, int, int]) -> None:
        self._links = skin.links
        self.node = scene.add_mesh_skinned(
            name, skin.vertices, skin.faces, skin_weights=strongest_weights(skin.weights),
            color=colour,
            # With both walls drawn, each can be more translucent.
            side='double', receive_shadow=False,
            bone_wxyzs=np.array([wxyz(rotation) for rotation in skin.rest.rotation]),
            bone_positions=skin.rest.position)

    def move(self, pose: Pose, opacity: float) -> None:
        """Set the pose of the 25 links and the opacity [1], if the mesh is visible."""
        if not self.node.visible:
            return
        for bone, link in zip(self.node.bones, self._links):
            bone.wxyz = wxyz(pose.rotation[link])
            bone.position = pose.position[link]
        shown = None if opacity == 1. else opacity
        if self.node.opacity != shown:
            self.node.opacity = shown


def strongest_weights(weights: np.ndarray) -> np.ndarray:
    """Keep the `BONES_PER_VERTEX` largest weights of each row, normalised to sum to 1."""
    least = np.sort(weights, axis=1)[:, -BONES_PER_VERTEX, None]
    kept = np.where(weights >= least, weights, 0.)
    return kept / kept.sum(axis=1, keepdims=True)


def wrist_pose(state: HandState) -> Pose:
    """Return the wrist's pose of a state."""
    return Pose(state.wrist_rotation, state.wrist_position)


def anchor_near(anchor: Pose, state: HandState) -> Pose:
    """Move an anchor towards the wrist, without rotation, so that the hand stays in view.

    Parameters
    ----------
    anchor : Pose
        See `HandScene.draw`.
    state : HandState

    Returns
    -------
    Pose
    """
    off = state.wrist_position - anchor.position
    share = MAX_ANCHOR_DISTANCE / max(float(np.linalg.norm(off)), MAX_ANCHOR_DISTANCE)
    return anchor._replace(position=state.wrist_position - share * off)


def _in_wrist(state: HandState) -> Pose:
    """Return the pose of the links in the wrist frame."""
    back = state.wrist_rotation.T
    return Pose(back @ state.pose.rotation,
                (state.pose.position - state.wrist_position) @ state.wrist_rotation)


def wxyz(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """Return a rotation matrix (3, 3) as the browser has it: w, x, y, z."""
    x, y, z, w = quaternion(rotation.tolist())
    return w, x, y, z


def light(scene: 'SceneApi') -> None:
    """Add lights from the side, which show the fingers' roundness, background and floor."""
    scene.set_background_image(np.full((2, 2, 3), BACKGROUND_RGB, dtype=np.uint8), format='png')
    # viser's default environment map lights all sides equally.
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere('/light/sky', sky_color=(255, 250, 244),
                               ground_color=(120, 110, 130), intensity=1.)
    scene.add_light_directional('/light/key', intensity=3., position=(.2, .8, .6),
                                cast_shadow=True)
    scene.add_light_directional('/light/rim', color=(190, 215, 255), intensity=1.2,
                                position=(-.2, -.9, .35))
    scene.add_grid('/floor', plane='xy', infinite_grid=True, position=(0., 0., FLOOR_HEIGHT),
                   cell_size=.02, section_size=.1, cell_color=(34, 43, 56),
                   section_color=(46, 57, 73), fade_distance=1.5, shadow_opacity=.3)


def place_camera(camera: 'CameraHandle', hands: int, aspect: float,
                 extent: Extent = PERSON_EXTENT) -> None:
    """Place the camera above some hands, side by side.

    Parameters
    ----------
    camera : viser.CameraHandle
    hands : int
    aspect : float
        Width by height of the picture [1].
    extent : Extent, optional
        Of the largest of them.
    """
    height = 2. * np.linalg.norm(CAMERA_OFFSET) * np.tan(.5 * VIEWER_FIELD_OF_VIEW)
    # On a phone the panel covers the lower part of the picture.
    free = PHONE_FREE_SHARE if aspect < PHONE_ASPECT else 1.
    length, width = extent.far - extent.near, 2. * extent.aside + (hands - 1) * HAND_SPACING
    away = max(length / free, width / aspect) / height
    middle = .5 * (extent.near + extent.far) - .5 * (1. - free) * away * height
    at = np.array((middle, 0., 0.))
    camera.fov = VIEWER_FIELD_OF_VIEW
    # Setting the position moves the target too.
    camera.position = at + away * CAMERA_OFFSET
    camera.look_at = at
