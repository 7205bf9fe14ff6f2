"""HTML bars of the 25 joint angles within their limits."""

import numpy as np

from ..core.model.hand import DIGITS, JOINTS
from ..drawing.palette import BLUE, VERMILLION

BAR_LIMIT_TOLERANCE = np.radians(.5)  # [rad]
# 'index_mcp_flexion' is labelled 'MCP flexion', below its digit.
JOINT_LABELS = [f'{joint.upper()} {motion}'
                for _, joint, motion in (name.split('_') for name in JOINTS)]
BAR_STYLE = f'''<style>
.ht {{font: 11px/1.35 system-ui, sans-serif; padding: 2px 10px 8px}}
.ht h4 {{margin: 6px 0 1px; font-size: 11px; text-transform: capitalize}}
.ht div {{display: grid; grid-template-columns: 86px 22px 1fr 18px 34px; gap: 4px}}
.ht div {{align-items: center; font-variant-numeric: tabular-nums}}
.ht i {{height: 7px; border-radius: 3px; background: #8884; position: relative; overflow: hidden}}
.ht b {{position: absolute; top: 0; bottom: 0; background: {BLUE}}}
.ht .at b {{background: {VERMILLION}}}
.ht u {{position: absolute; top: 0; bottom: 0; width: 1px; background: #6b737b}}
.ht s {{font-size: 9px; text-decoration: none; opacity: .6; text-align: right}}
.ht i + s {{text-align: left}}
.ht span:last-child {{text-align: right}}
.ht .locked {{opacity: .45}}
</style>'''


def angle_bars(angles: np.ndarray, limits: np.ndarray) -> str:
    """Return HTML with a bar for each joint, scaled from its lower to its upper limit.

    A bar is filled from zero to the angle, in another colour at a limit; its ends are labelled
    with the limits in degrees.

    Parameters
    ----------
    angles : ndarray, shape (25,)
        [rad]
    limits : ndarray, shape (25, 2)
        [rad]

    Returns
    -------
    str
        HTML.
    """
    lower, upper = limits.T
    span = np.maximum(upper - lower, 1e-9)
    zero, here = (np.clip(100. * (value - lower) / span, 0., 100.) for value in (0., angles))
    at_limit = (angles < lower + BAR_LIMIT_TOLERANCE) | (angles > upper - BAR_LIMIT_TOLERANCE)
    degrees, ends = np.degrees(angles), np.degrees(limits)
    parts = [BAR_STYLE, '<section class="ht">']
    for joint, name in enumerate(JOINT_LABELS):
        if joint % 5 == 0:
            parts.append(f'<h4>{DIGITS[joint // 5]}</h4>')
        if upper[joint] == lower[joint]:
            parts.append(f'<div class="locked"><span>{name}</span><s></s><i></i><s></s>'
                         '<span>fixed</span></div>')
            continue
        left, right = sorted((zero[joint], here[joint]))
        least, most, now = map(round, (*ends[joint], degrees[joint]))
        kind = ' class="at"' if at_limit[joint] else ''
        parts.append(
            f'<div{kind}><span>{name}</span><s>{least}</s><i><b style="left:{left:.0f}%;width:'
            f'{right - left:.0f}%"></b><u style="left:{zero[joint]:.0f}%"></u></i><s>{most}</s>'
            f'<span>{now}°</span></div>')
    parts.append('</section>')
    return ''.join(parts)
