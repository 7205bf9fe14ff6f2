"""HTML bars of how much of each movement a calibration has seen."""

from collections.abc import Mapping
from html import escape

from ..drawing.palette import BLUE, BLUISH_GREEN

COVERAGE_STYLE = f'''<style>
.cb {{font: 12px/1.4 system-ui, sans-serif; padding: 4px 12px 8px}}
.cb div {{display: grid; grid-template-columns: 104px 1fr; gap: 6px; align-items: center}}
.cb i {{height: 7px; border-radius: 3px; background: #8884; overflow: hidden}}
.cb b {{display: block; height: 7px; background: {BLUE}}}
.cb .all b {{background: {BLUISH_GREEN}}}
.cb p {{margin: 2px 0 6px; font-weight: 600}}
</style>'''


def coverage_bars(text: str, shares: Mapping[str, float]) -> str:
    """Return HTML with what to do next, and a bar for each movement.

    Parameters
    ----------
    text : str
    shares : mapping of str to float
        By name of the movement, from 0 to 1.

    Returns
    -------
    str
        HTML.
    """
    bars = ''.join(
        f'<div{" class=all" if share >= 1. else ""}><span>{escape(name)}</span>'
        f'<i><b style="width:{100. * share:.0f}%"></b></i></div>'
        for name, share in shares.items())
    return f'{COVERAGE_STYLE}<section class="cb"><p>{escape(text)}</p>{bars}</section>'
