"""The palm's triangle: SciPy's rigid fit, hidden corners and faults."""

import numpy as np
import pytest
from helpers.palms import TEMPLATE, random_palm, vectors
from scipy.spatial.transform import Rotation

from hand_tracker.core.model.palm_triangle import (
    PalmLimits,
    complete_palm,
    palm_fault,
    rigid_palm,
    triad,
)
from hand_tracker.core.model.states import PalmState

SOUND = (1.5, 0.3, 0.2)  # stretch, shrink, flatness


def test_triad_is_right_handed_with_y_from_q_to_p():
    r, p, q = TEMPLATE
    x, y, z = np.array(triad(*vectors(r, p, q)))
    np.testing.assert_allclose(y, (p - q) / np.linalg.norm(p - q), atol=1e-12)
    np.testing.assert_allclose(np.cross(x, y), z, atol=1e-12)


def test_rigid_palm_is_the_least_squares_fit():
    rng = np.random.default_rng(4)
    for _ in range(200):
        markers, _, _ = random_palm(rng, noise=.003)
        axes, origin = rigid_palm(tuple(vectors(*markers)), TEMPLATE)
        expected, _ = Rotation.align_vectors(
            markers - markers.mean(axis=0), TEMPLATE - TEMPLATE.mean(axis=0))
        np.testing.assert_allclose(np.array(axes).T, expected.as_matrix(), atol=1e-9)
        np.testing.assert_allclose(
            origin, markers.mean(axis=0) - expected.apply(TEMPLATE.mean(axis=0)), atol=1e-12)


def frame_of(seen_palm, rotation, position):
    palm = TEMPLATE @ rotation.T + position
    shown = np.where(np.array(seen_palm)[:, None], palm, np.nan)
    return tuple(map(tuple, shown)), palm


def carried(seen_palm, rotation, position, before, origin):
    points, palm = frame_of(seen_palm, rotation, position)
    expected = tuple(map(tuple, TEMPLATE @ before.T + origin))
    return np.array(complete_palm(points, expected, tuple(bool(s) for s in seen_palm))), palm


@pytest.mark.parametrize('hidden', [0, 1, 2])
def test_two_markers_carry_the_third_through_a_turn_of_their_line(hidden):
    rng = np.random.default_rng(hidden)
    before = Rotation.random(random_state=rng).as_matrix()
    pair = [i for i in range(3) if i != hidden]
    line = before @ (TEMPLATE[pair[1]] - TEMPLATE[pair[0]])
    # A rotation about an axis normal to the seen side is told by that side in full.
    axis = np.cross(line, rng.normal(size=3))
    after = Rotation.from_rotvec(.4 * axis / np.linalg.norm(axis)).as_matrix() @ before
    found, palm = carried([i != hidden for i in range(3)], after, np.array((.1, .2, .3)),
                          before, rng.normal(size=3))
    np.testing.assert_allclose(found, palm, atol=1e-12)


@pytest.mark.parametrize('shown', [0, 1, 2])
def test_one_marker_carries_the_others_along(shown):
    rotation = Rotation.from_euler('xyz', (.1, .2, .3)).as_matrix()
    found, palm = carried([i == shown for i in range(3)], rotation, np.ones(3),
                          rotation, np.zeros(3))
    np.testing.assert_allclose(found, palm, atol=1e-12)


@pytest.mark.parametrize('change, state', [
    (lambda m: m, PalmState.TRACKED),
    (lambda m: m * 1.1, PalmState.TRACKED),
    (lambda m: m * 1.6, PalmState.TOO_FAR_APART),
    (lambda m: m * .31, PalmState.TRACKED),
    (lambda m: m * .29, PalmState.TOO_CLOSE),
    (lambda m: m * .001, PalmState.TOO_CLOSE),
    (lambda m: m[[0, 1, 1]], PalmState.COINCIDENT),
    (lambda m: m[[0, 0, 0]], PalmState.COINCIDENT),
    (lambda m: np.array((m[0], m[1], m[0] + .5 * (m[1] - m[0]))), PalmState.COLLINEAR),
])
def test_palm_fault_names_the_fault(change, state):
    assert palm_fault(change(TEMPLATE), TEMPLATE, PalmLimits(*SOUND)) == state


@pytest.mark.parametrize('i, j, third', [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_each_side_of_the_palm_may_be_too_long_or_vanish(i, j, third):
    markers = TEMPLATE.copy()
    markers[j] = markers[i] + 1.55 * (markers[j] - markers[i])
    markers[third] = .5 * (markers[i] + markers[j])
    assert palm_fault(markers, TEMPLATE, PalmLimits(*SOUND)) == PalmState.TOO_FAR_APART
    markers = TEMPLATE.copy()
    markers[j] = markers[i]
    assert palm_fault(markers, TEMPLATE, PalmLimits(*SOUND)) == PalmState.COINCIDENT


def test_a_palm_is_collinear_by_its_area_over_that_of_a_triangle_of_its_size():
    markers = .8 * TEMPLATE
    markers[0] += .5 * (markers[1:].mean(axis=0) - markers[0])
    area, whole = (np.linalg.norm(np.cross(m[1] - m[0], m[2] - m[0])) for m in (markers, TEMPLATE))
    size = np.mean([np.linalg.norm(markers[i] - markers[j]) / np.linalg.norm(
        TEMPLATE[i] - TEMPLATE[j]) for i, j in ((0, 1), (1, 2), (2, 0))])
    share = area / (size ** 2 * whole)
    assert palm_fault(markers, TEMPLATE, PalmLimits(1.5, .3, .99 * share)) == PalmState.TRACKED
    assert palm_fault(markers, TEMPLATE, PalmLimits(1.5, .3, 1.01 * share)) == PalmState.COLLINEAR
