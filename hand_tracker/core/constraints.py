"""Constraints of the hand as named switches, for comparisons and the viewer."""

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .model.hand import JOINTS, Hand
from .options import TrackerOptions

UNLIMITED_ANGLE = np.radians(170.)  # [rad] a limit beyond every posture
# Masks of `JOINTS`, (25,); the CMC flexion of the fingers, which is not tracked, is in neither.
FLEXION_MASK = np.array(['flexion' in joint and not (
    joint.endswith('cmc_flexion') and not joint.startswith('thumb')) for joint in JOINTS])
ABDUCTION_MASK = np.array(['abduction' in joint for joint in JOINTS])


class Change(NamedTuple):
    """Change of hand and options that switches a constraint off or on.

    Attributes
    ----------
    options : dict
        New values of fields of `TrackerOptions`.
    hand : callable
        Returns the changed hand.
    """

    options: dict[str, Any] = {}
    hand: Callable[[Hand], Hand] = lambda hand: hand


class Constraint(NamedTuple):
    """One constraint as a switch.

    Attributes
    ----------
    about : str
        Its effect in one sentence.
    off : Change
    on : Change, optional
        For a constraint that is off by default.
    """

    about: str
    off: Change
    on: Change | None = None

    @property
    def default(self) -> bool:
        """Whether the constraint is on by default."""
        return self.on is None


def without_limits(joints: np.ndarray) -> Change:
    """Return the change that removes the limits of some joints.

    Parameters
    ----------
    joints : ndarray of bool, shape (25,)
        Mask of `JOINTS`.
    """
    return Change(hand=lambda hand: hand.replace(limits=np.where(
        joints[:, None], (-UNLIMITED_ANGLE, UNLIMITED_ANGLE), hand.limits)))


CONSTRAINTS = {
    'Joint limits': Constraint('No joint bends farther than it can',
                               without_limits(FLEXION_MASK | ABDUCTION_MASK)),
    'DIP coupling': Constraint('DIP follows PIP, thumb IP follows MCP', Change(
        hand=lambda hand: hand.replace(coupling=np.zeros_like(hand.coupling)))),
    'Rigidity': Constraint('Digits do not go through each other', Change({'rigidity': False})),
    'Friction': Constraint('Hidden digits are dragged along by those that touch them',
                           Change({'friction': 0.}), Change({'friction': .5})),
    'Inertia': Constraint('Hidden markers go on as they moved', Change({'inertia': 0.})),
    'Transdigital correlation': Constraint('Hidden digits move as they have moved with the others',
                                           Change({'transdigital_memory': 0.})),
    'Candidate space': Constraint('Hidden digits stay near their neighbours', Change({
        'bound_index_middle': np.pi, 'bound_middle_ring': np.pi, 'bound_ring_little': np.pi})),
    'Palm from fingers': Constraint('Fingers correct a hidden palm marker',
                                    Change({'palm_from_fingers': False})),
    'Smoothing': Constraint('Noise of seen markers is filtered', Change({'smoothing': False})),
    'Wrong markers': Constraint('Outliers and exchanged labels are found',
                                Change({'outlier_gate': 0., 'swap_margin': 0.})),
}
DEFAULT_CONSTRAINTS = frozenset(
    name for name, constraint in CONSTRAINTS.items() if constraint.default)


def constrained(hand: Hand, options: TrackerOptions,
                wanted: Collection[str]) -> tuple[Hand, TrackerOptions]:
    """Return hand and options with some of the constraints only.

    Parameters
    ----------
    hand : Hand
    options : TrackerOptions
    wanted : collection of str
        Of `CONSTRAINTS`; one that is off by default and not wanted stays as it is.

    Returns
    -------
    hand : Hand
    options : TrackerOptions
    """
    for name, constraint in CONSTRAINTS.items():
        if (name in wanted) != constraint.default:
            change = constraint.off if constraint.on is None else constraint.on
            hand, options = change.hand(hand), replace(options, **change.options)
    return hand, options


def describe(wanted: Collection[str]) -> str:
    """Return a caption for some of the constraints, such as 'without Rigidity'."""
    off = [name for name in CONSTRAINTS if name in DEFAULT_CONSTRAINTS - set(wanted)]
    if not wanted:
        return 'without any constraint'
    if len(off) > 2:
        return f'with {len(wanted)} of {len(CONSTRAINTS)} constraints'
    return f'without {" and ".join(off)}' if off else 'with constraints'
