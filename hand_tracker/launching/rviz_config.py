"""RViz's configuration of one launch: which hand it follows, and which robots it shows."""

from collections.abc import Mapping

SHOWN_TOPICS = 'robot_description', 'hand_markers', 'hand_skin'
SHOWN_ROBOT = 'Name: Robot of the {} hand\n      Enabled: {}\n'
FOLLOWED = 'Target Frame: {}middle_knuckle'  # by RViz's view: amid the hand, still in the palm
VIEW_DISTANCE = 'Distance: {:g}\n'  # [m] of RViz's view from what it follows
ONE_HAND, SECOND_HAND, ROBOTS_BESIDE = .6, .7, .35  # [m] for one hand, more for what is beside


def rviz_config(packaged: str, prefix: str, namespace: str, hand_count: int,
                robots: Mapping[str, str]) -> str:
    """Return RViz's configuration, which follows the first hand and sees all that is shown.

    Parameters
    ----------
    packaged : str
        Text of config/hand_tracker.rviz.
    prefix : str
        Of the first hand's frames.
    namespace : str
        Of its topics; empty for none.
    hand_count : int
    robots : mapping of str to str
        TF prefix of each shown robot, by the side of its hand.

    Returns
    -------
    str
        The same text where nothing is to be changed.
    """
    config = packaged.replace(FOLLOWED.format('right_'), FOLLOWED.format(prefix))
    if namespace:
        for topic in SHOWN_TOPICS:
            config = config.replace(f'Value: {topic}\n', f'Value: {namespace}/{topic}\n')
    for side, own in robots.items():
        config = config.replace(SHOWN_ROBOT.format(side, 'false'), SHOWN_ROBOT.format(side, 'true'))
        config = config.replace(f'TF Prefix: {side}_robot', f'TF Prefix: {own}')
        config = config.replace(f'Value: {side}_robot/', f'Value: {own}/')
    distance = ONE_HAND + SECOND_HAND * (hand_count - 1) + ROBOTS_BESIDE * bool(robots)
    return config.replace(VIEW_DISTANCE.format(ONE_HAND), VIEW_DISTANCE.format(distance))
