"""Fit one digit to the markers on it."""

from typing import NamedTuple

import numpy as np

from .arrow_solver import covariance, fit_angles, solve_shape
from .digit_chain import ANGLES, ROOT_PART, place_markers
from .frame_choice import spread_frames
from .marker_residuals import DigitProblem, PosturePrior
from .palm_template import ELSEWHERE

# Distance of markers from a digit's first joint, in that of the straight digit's farthest one as it
# is expected, and [m] besides, beyond which they are others; on recorded hands 1.1 at most. The
# margin is wider where no landmark of the palm tells where first joints are. Ours.
MARKER_REACH, MARKER_REACH_MARGIN, UNPLACED_MARGIN = 1.25, .01, .04
LEAST_WITHIN_REACH = .2       # of a marker's frames; with fewer its label is wrong. Ours
ELSEWHERE_AT_FIRST = .04      # [m] as `ELSEWHERE`, by the usual shape, which people leave. Ours
MOST_STRAYS = .2              # of all frames; with more, labels are wrong. Ours
CHOSEN_FRAMES = 150
LEAST_DISTANCE = .002         # [m] of chosen frames, in the space of the digit's markers
# Frames as good as independent: errors of skin and palm persist as long as a posture. Ours.
INDEPENDENT_POSTURES = 40
# Of a finger and of a thumb with one marker: each frame's angles meet it in many shapes, of which
# errors of skin and usual postures would choose one farther from the person's. From captures.
ONE_MARKER_POSTURES, ONE_MARKER_POSTURES_OF_THUMB = 4., .03
FIRST_NOISE = .001            # [m] of a marker on an axis, skin included
# [m] The lower one also of a marker that the tracker meets: the palm's pose has its noise too.
NOISE_BOUNDS = (.0006, .004)
NOISE_ROUNDS = 4              # fits with the noise estimated anew
SEARCHED_ROUNDS = 2           # after which each frame's posture is sought again from everywhere
SHAPE_ITERATIONS = 25
# [degrees] Turn and three flexions from which a frame's posture is sought: straight, bent at the
# first or the second joint, a fist, and a bent finger raised.
FINGER_STARTS = ((0, 5, 10, 5), (0, 40, 20, 10), (0, 30, 70, 20), (0, 70, 80, 20), (0, -15, 40, 10))
THUMB_STARTS = ((0, 0, 10, 10), (25, 0, 10, 10), (-25, 0, 10, 10), (0, 25, 10, 10),
                (0, -25, 10, 10), (0, 0, 45, 45), (30, 20, 30, 40), (-30, -20, 30, 40))


class DigitFit(NamedTuple):
    """A digit as fitted.

    Attributes
    ----------
    problem : DigitProblem
        With the chosen frames and the noise found.
    shape : ndarray, shape (p,)
        Parameters of `Chain`.
    angles : ndarray, shape (n, k)
        Of the chosen frames [rad].
    covariance : ndarray, shape (p, p)
        Of the shape.
    """

    problem: DigitProblem
    shape: np.ndarray
    angles: np.ndarray
    covariance: np.ndarray

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviations of the shape, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))


def posture_starts(is_thumb: bool, posture: PosturePrior) -> np.ndarray:
    """Return the initial postures of each frame's search, shape (s, k) [rad]."""
    if not is_thumb:
        return np.radians(FINGER_STARTS)
    starts = np.zeros((len(THUMB_STARTS), len(posture.mean)))
    starts[:, :ANGLES] = np.radians(THUMB_STARTS)
    starts[:, 1] += posture.mean[1]
    return starts


def within_reach(problem: DigitProblem, is_placed: bool) -> DigitProblem:
    """Return the problem without markers where the digit cannot be: ghosts, or wrong labels.

    Parameters
    ----------
    problem : DigitProblem
    is_placed : bool
        Whether a marker of the palm is at a landmark.
    """
    shape = problem.prior.mean
    straight = place_markers(problem.chain, shape, np.zeros((1, len(problem.posture.mean))))[0]
    farthest = np.linalg.norm(straight - shape[ROOT_PART], axis=1).max()
    is_beyond = np.linalg.norm(problem.points - shape[ROOT_PART], axis=2) > (
        MARKER_REACH * farthest + (MARKER_REACH_MARGIN if is_placed else UNPLACED_MARGIN))
    return problem._replace(points=np.where(is_beyond[..., None], np.nan, problem.points))


def chosen_problem(problem: DigitProblem, is_thumb: bool,
                   shape: np.ndarray | None = None) -> DigitProblem:
    """Return the problem reduced to the frames of best coverage, weighted.

    Parameters
    ----------
    problem : DigitProblem
    is_thumb : bool
    shape : ndarray, shape (p,), optional
        Of an earlier fit, or else the usual one, by which frames with a marker that is elsewhere
        are left out: they are far from the others, and would be chosen first.
    """
    frames = _without_strays(
        problem, posture_starts(is_thumb, problem.posture),
        *((problem.prior.mean, ELSEWHERE_AT_FIRST) if shape is None else (shape, ELSEWHERE)))
    independent = (INDEPENDENT_POSTURES if len(problem.noise) > 1
                   else ONE_MARKER_POSTURES_OF_THUMB if is_thumb else ONE_MARKER_POSTURES)
    return problem._replace(
        points=problem.points[frames], weight=min(1., independent / max(len(frames), 1)))


def _without_strays(problem: DigitProblem, starts: np.ndarray, shape: np.ndarray,
                    most_miss: float) -> np.ndarray:
    """Choose frames without a marker farther from its place [m]; all where these are many."""
    points, strays = problem.points.copy(), 0
    frames = chosen = spread_frames(points, CHOSEN_FRAMES, LEAST_DISTANCE)
    while len(frames):
        some = problem._replace(points=points[frames])
        _, misses = fit_postures(some, shape, starts)
        is_stray = (misses > most_miss).any(axis=1)
        if not is_stray.any():
            return frames
        strays += np.count_nonzero(is_stray)
        if strays > MOST_STRAYS * len(points):
            break
        points[frames[is_stray]] = np.nan
        frames = spread_frames(points, CHOSEN_FRAMES, LEAST_DISTANCE)
    return chosen


def fit_postures(problem: DigitProblem, shape: np.ndarray,
                 starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit a digit's postures; return them, (n, k), and the markers' misses, (n, m) [rad, m]."""
    angles, _ = fit_angles(problem, shape, starts)
    return angles, np.linalg.norm(
        place_markers(problem.chain, shape, angles) - problem.points, axis=2)


def fit_digit(problem: DigitProblem, starts: np.ndarray,
              shape: np.ndarray | None = None, rounds: int = NOISE_ROUNDS) -> DigitFit:
    """Fit a digit's shape to the frames of a problem.

    Parameters
    ----------
    problem : DigitProblem
        With the chosen frames.
    starts : ndarray, shape (s, k)
        Initial postures of each frame's search [rad].
    shape : ndarray, shape (p,), optional
        Where to begin; else the usual shape.
    rounds : int, optional
        Fits with the noise estimated anew.

    Returns
    -------
    DigitFit
    """
    shape = problem.prior.mean if shape is None else shape
    angles, _ = fit_angles(problem, shape, starts)
    for i in range(rounds):
        solved = solve_shape(problem, shape, angles, SHAPE_ITERATIONS)
        shape = solved.shape
        problem = problem._replace(noise=_noise(problem, shape, solved.angles))
        angles = solved.angles
        if i < min(rounds - 1, SEARCHED_ROUNDS):
            everywhere = np.broadcast_to(
                starts[:, None], (len(starts), *angles.shape))
            angles, _ = fit_angles(problem, shape, np.concatenate((angles[None], everywhere)))
    return DigitFit(problem, shape, angles, covariance(problem, shape, angles))


def _noise(problem: DigitProblem, shape: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the noise of the markers by their residuals, (m,) [m]."""
    misses = place_markers(problem.chain, shape, angles) - problem.points
    seen = np.isfinite(misses)
    # Each frame's angles take up some of its coordinates.
    free = seen.sum() - angles.size
    if free <= 0 or len(problem.noise) < 2:
        return np.full_like(problem.noise, FIRST_NOISE)
    square = np.nansum(np.minimum(misses ** 2, (4. * problem.noise[:, None]) ** 2)) / free
    return np.clip(problem.meets * np.sqrt(square), *NOISE_BOUNDS)
