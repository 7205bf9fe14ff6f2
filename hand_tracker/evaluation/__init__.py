"""Measure the tracker: on captured hands, beside plain baselines, and on made motions."""
