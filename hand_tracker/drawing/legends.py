"""Legends beside the axes of a figure, with every matplotlib from 3.5 (Ubuntu 22.04) on."""

from typing import Any

import matplotlib
from matplotlib.figure import Figure

KEEPS_ROOM_FOR_LEGENDS = (3, 7)  # version of matplotlib


def add_legend_below(figure: Figure, handles: list[Any], **style: Any) -> None:
    """Add a legend in one row below the axes of a figure with a constrained layout.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    handles : list of matplotlib artists
        With labels.
    **style
        As of `Figure.legend`.
    """
    place = 'lower center'
    if matplotlib.__version_info__[:2] >= KEEPS_ROOM_FOR_LEGENDS:
        place = f'outside {place}'
    else:
        # An empty label below all axes reserves the room.
        figure.supxlabel(' ')
    figure.legend(handles=handles, loc=place, ncol=len(handles), frameon=False, fontsize=8, **style)
