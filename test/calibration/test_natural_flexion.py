"""The line of a person's second flexion over the first, beside that of an average person."""

import numpy as np
import pytest

from hand_tracker.calibration.natural_flexion import fit_flexion_line
from hand_tracker.core.model.hand import Hand, average_natural_flexion

AVERAGE = average_natural_flexion()[0]


def postures(slope, offset, spread, count=300, seed=1):
    """Return first and second flexions about a line."""
    random = np.random.default_rng(seed)
    first = random.uniform(-.1, 1.1, count)
    return first, slope * first + offset + spread * random.standard_normal(count)


@pytest.mark.parametrize('slope, offset', [(.5, .3), (2.5, -.2), (0., .8)])
def test_the_line_is_found_again(slope, offset):
    line = fit_flexion_line(*postures(slope, offset, .05), AVERAGE)
    assert line.row[:2] == pytest.approx((slope, offset), abs=.12)
    assert (line.deviations < .7 * line.before).all()
    # From the average's spread towards the person's own
    assert .05 < line.row[2] < .6 * AVERAGE[2]


def test_without_postures_it_is_the_average_person_s():
    line = fit_flexion_line(np.zeros(0), np.zeros(0), AVERAGE)
    assert line.row == pytest.approx(AVERAGE)
    assert line.deviations == pytest.approx(line.before)


def test_few_postures_move_it_little_and_many_much():
    first, second = postures(0., .8, .05)
    rows = [fit_flexion_line(first[:count], second[:count], AVERAGE).row for count in (1, 5, 300)]
    # At an almost straight first joint, where the average person's is at .17.
    found = [slope * .1 + offset for slope, offset, _ in rows]
    assert .1 < found[0] < found[1] < found[2]
    assert found[0] < .4 < .7 < found[2]


def test_a_still_digit_leaves_the_slope_unknown():
    still = fit_flexion_line(np.full(300, .2), np.full(300, .3), AVERAGE)
    moving = fit_flexion_line(*postures(AVERAGE[0], 0., .05), AVERAGE)
    assert still.deviations[0] > 3. * moving.deviations[0]
    assert still.row[0] * .2 + still.row[1] == pytest.approx(.3, abs=.02)


def test_more_scattered_postures_give_a_wider_spread():
    spreads = [fit_flexion_line(*postures(1., .1, spread), AVERAGE).row[2]
               for spread in (.05, .3, .6)]
    assert spreads == sorted(spreads) and spreads[2] > AVERAGE[2]


@pytest.mark.parametrize('first, second', [
    (np.full(300, .1), np.linspace(0., 1.5, 300)), (np.linspace(0., 1.5, 300), np.zeros(300)),
    (np.linspace(0., 1.4, 300), np.linspace(1.4, 0., 300)), (np.zeros(300), np.zeros(300))])
def test_a_digit_that_bends_in_one_joint_alone_has_a_line_too(first, second):
    row = fit_flexion_line(first, second, AVERAGE).row
    hand = Hand.scaled(natural_flexion=np.tile(row, (5, 1)))  # within what is allowed
    misses = second - hand.natural_flexion[0, 0] * first - hand.natural_flexion[0, 1]
    assert np.abs(misses.mean()) < .35
