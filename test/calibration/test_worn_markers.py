"""Choice of the tracker's eight markers among those of a take."""

import numpy as np
import pytest

from hand_tracker.calibration.marker_names import identify
from hand_tracker.calibration.worn_markers import worn_names

PALM = {'wrist': (0., 0., 0.), 'index_mcp': (.09, .03, 0.), 'little_mcp': (.075, -.04, 0.),
        'back_hand_1': (.01, .03, .01), 'back_hand_2': (-.005, -.01, .01),
        'back_hand_3': (.01, -.06, .01)}


@pytest.mark.parametrize(('missing', 'corners'), [
    ((), ('wrist', 'index_mcp', 'little_mcp')),
    # Labelled knuckles stay, though other markers make a wider triangle.
    (('wrist',), ('back_hand_2', 'index_mcp', 'little_mcp')),
    (('wrist', 'little_mcp'), ('back_hand_1', 'index_mcp', 'back_hand_3'))])
def test_the_palms_corners_are_those_of_the_paper_as_far_as_they_are_there(missing, corners):
    palm = {name: np.array(place) for name, place in PALM.items() if name not in missing}
    assert worn_names(tuple(filter(None, identify(palm))), palm)[:3] == corners
