"""Note on the joints that a layout does not show."""

from ..core.model.marker_layout import MARKERS
from ..core.tracker import HandTracker


def unobserved_note(tracker: HandTracker) -> str:
    """Return the note on joints that a layout other than the paper's does not show, if any."""
    if tracker.layout.names == MARKERS or not (unobserved := tracker.unobserved_joints()):
        return ''
    return ('joints that these markers do not show, which follow others or stay at rest: '
            + ', '.join(unobserved))
