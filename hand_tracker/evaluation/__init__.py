"""Evaluations of the tracker against the paper, captures, baselines and its own variants.

Nothing but the command `hand_tracker evaluate` imports this package. An evaluation is a module
with

- ``evaluate(options)``, which yields rows: dicts of plain numbers and strings with the key
  ``evaluation`` first; keys of times measured by the clock end in ``_us``,
- ``tables(rows)``, which returns `Table`s,
- ``pictures(rows, folder)``, which draws PNG files and returns their `Picture`s,
- optionally ``losses(rows)``, which returns `Losses`: where the tracker is worse than the paper,
  a baseline or a variant, and why.
"""

from collections.abc import Collection
from importlib import import_module
from types import ModuleType
from typing import NamedTuple


class Evaluation(NamedTuple):
    """Entry of the list of evaluations.

    Attributes
    ----------
    module : str
        Name of its module in this package.
    title : str
        Heading in the results.
    summary : str
        Line of help.
    judges : tuple of str
        Kinds of files, of which at least one is needed: 'captures'; 'takes' of real markers;
        'layouts', takes with markers named as in a layout preset. Empty: it needs no files.
    """

    module: str
    title: str
    summary: str
    judges: tuple[str, ...] = ()

    def can_judge(self, given: Collection[str]) -> bool:
        """Return whether the given kinds of files are enough."""
        return not self.judges or any(kind in given for kind in self.judges)

    def load(self) -> ModuleType:
        """Import the module of the evaluation."""
        return import_module(f'{__name__}.{self.module}')


EVALUATIONS = {
    'cameras': Evaluation(
        'camera_count', 'Fewer cameras (Table 2a)', 'Table 2a: 8 cameras against 6, 4 and 2'),
    'rates': Evaluation(
        'frame_rates', 'Lower rates (Table 2b)', 'Table 2b: 480 Hz against 240 to 30 Hz'),
    'ablation': Evaluation(
        'ablation', 'Without each constraint (Fig. 13)', 'Fig. 13: each constraint off in turn'),
    'markers': Evaluation(
        'unseen_markers', 'Markers that the tracker did not get',
        'real markers: a hand fitted to all of them, tracked from eight', judges=('takes',)),
    'layouts': Evaluation(
        'layout_markers', 'All markers of a layout worn',
        'real markers: a hand tracked from all, each left out once', judges=('layouts',)),
    'recordings': Evaluation(
        'captured_hands', 'Captured hands',
        'errors per joint class on captures, beside a plain baseline', judges=('captures',)),
    'occlusion': Evaluation(
        'hidden_markers', 'Hidden markers',
        'hidden markers on captures, beside three baselines', judges=('captures',)),
    'labelling': Evaluation(
        'point_labelling', 'Points without names',
        'labels of points without names, with ghosts and hidden markers',
        judges=('captures', 'takes', 'layouts')),
    'landmarks': Evaluation(
        'landmark_steadiness', 'Landmarks of cameras',
        'breathing of bones and jitter of 21 landmarks, as given and tracked',
        judges=('captures',)),
    'noise': Evaluation(
        'noise_sensitivity', 'Marker noise and size of the hand',
        'marker noise of 0 to 2 mm, hand size wrong by up to 10 %'),
    'steadiness': Evaluation(
        'steadiness', 'Steadiness',
        'error and step from frame to frame of each class of angles, beside the true step'),
    'deviations': Evaluation(
        'angle_deviations', 'Deviations of angles',
        'how many errors of angles lie within their published deviations'),
    'solvers': Evaluation(
        'solvers', 'Solvers', 'palm and finger solvers against each other'),
}
