"""Track the 25 joints of a human hand from eight optical markers.

The names below are the public API. Each is imported when it is first used, so that
``import hand_tracker`` alone loads nothing else, not even numpy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .calibration.fit import fit_hand
    from .core.model.hand import JOINTS, Hand
    from .core.model.marker_layout import MarkerLayout
    from .core.options import TrackerOptions
    from .core.tracker import HandState, HandTracker
    from .files.hand_file import load_hand, save_hand

__version__ = '0.2.0'

__all__ = ['Hand', 'HandState', 'HandTracker', 'JOINTS', 'MarkerLayout', 'TrackerOptions',
           'fit_hand', 'load_hand', 'save_hand']

_MODULES = {
    'JOINTS': '.core.model.hand',
    'Hand': '.core.model.hand',
    'HandState': '.core.tracker',
    'HandTracker': '.core.tracker',
    'MarkerLayout': '.core.model.marker_layout',
    'TrackerOptions': '.core.options',
    'fit_hand': '.calibration.fit',
    'load_hand': '.files.hand_file',
    'save_hand': '.files.hand_file',
}


def __getattr__(name: str) -> object:
    """Import a name of the public API when it is first used (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(import_module(_MODULES[name], __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
