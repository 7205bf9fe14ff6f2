"""The constraints of the hand, each of which can be taken off alone."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .model.hand import JOINTS

FREE = np.radians(170.)        # a limit that is none
FLEXION = np.array(['flexion' in joint and not (
    joint.endswith('cmc_flexion') and not joint.startswith('thumb')) for joint in JOINTS])
ABDUCTION = np.array(['abduction' in joint for joint in JOINTS])


class Change(NamedTuple):
    """What is changed to take a constraint off, or to put one on.

    Attributes
    ----------
    options : dict
        Fields of `TrackerOptions`.
    hand : callable
        Returns the changed hand, of one that has the constraint.
    """

    options: dict = {}
    hand: object = lambda hand: hand


class Constraint(NamedTuple):
    """One constraint as a switch.

    Attributes
    ----------
    about : str
        What one sees of it.
    off : Change
    on : Change, optional
        Where it is not there by default.
    """

    about: str
    off: Change
    on: Change | None = None

    @property
    def default(self):
        """Whether it is there by default."""
        return self.on is None


def free(joints):
    """Return the change to a hand without limits of some joints, a mask of `JOINTS`."""
    return Change(hand=lambda hand: hand.replace(
        limits=np.where(joints[:, None], (-FREE, FREE), hand.limits)))


UNCOUPLED = Change(hand=lambda hand: hand.replace(coupling=np.zeros_like(hand.coupling)))
UNBOUND = Change({
    'bound_index_middle': np.pi, 'bound_middle_ring': np.pi, 'bound_ring_little': np.pi})

CONSTRAINTS = {
    'Joint limits': Constraint('No joint bends farther than it can', free(FLEXION | ABDUCTION)),
    'DIP coupling': Constraint('DIP follows PIP, thumb IP follows MCP', UNCOUPLED),
    'Rigidity': Constraint('Digits do not go through each other', Change({'rigidity': False})),
    'Friction': Constraint('Hidden digits are dragged along by those that touch them',
                           Change({'friction': 0.}), Change({'friction': .5})),
    'Inertia': Constraint('Hidden markers go on as they moved', Change({'inertia': 0.})),
    'Transdigital correlation': Constraint('Hidden digits move as they have moved with the others',
                                           Change({'transdigital_memory': 0.})),
    'Candidate space': Constraint('Hidden digits keep near their neighbours', UNBOUND),
    'Palm from fingers': Constraint('A hidden palm marker is told by the fingers',
                                    Change({'palm_from_fingers': False})),
    'Smoothing': Constraint('Noise of seen markers is filtered', Change({'smoothing': False})),
    'Wrong markers': Constraint('Outliers and exchanged labels are found',
                                Change({'outlier_gate': 0., 'swap_margin': 0.})),
}
DEFAULT = frozenset(name for name, constraint in CONSTRAINTS.items() if constraint.default)


def constrained(hand, options, wanted):
    """Return hand and options with some of the constraints alone.

    Parameters
    ----------
    hand : Hand
    options : TrackerOptions
    wanted : collection of str
        Of `CONSTRAINTS`; those that are neither wanted nor there by default stay as they are.

    Returns
    -------
    hand : Hand
    options : TrackerOptions
    """
    for name, constraint in CONSTRAINTS.items():
        if (name in wanted) != constraint.default:
            change = constraint.off if constraint.default else constraint.on
            hand, options = change.hand(hand), replace(options, **change.options)
    return hand, options


def in_words(wanted):
    """Return what a person reads of some of the constraints, as 'without Rigidity'."""
    off = [name for name in CONSTRAINTS if name in DEFAULT - set(wanted)]
    if not wanted:
        return 'without any constraint'
    if len(off) > 2:
        return f'with {len(wanted)} of {len(CONSTRAINTS)} constraints'
    return f'without {" and ".join(off)}' if off else 'with constraints'
