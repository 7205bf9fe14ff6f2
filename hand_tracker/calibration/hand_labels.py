"""Labels of points as systems and skeletons write them: which hand, and which landmark of it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from ..core.model.hand import DIGITS
from ..core.model.marker_layout import MarkerLayout
from ..messages.marker_ids import HandIds, ids_by_name
from .marker_names import (
    LABEL_SIDES,
    SYNONYMS,
    WORD_GAP,
    canonical_name,
    identify,
    usual_words,
)

# Words that say nothing of the place: of WebXR, MediaPipe, and axes of joints in BVH files.
EMPTY_WORDS = ('finger', 'phalanx', 'bone', 'joint', 'fe', 'aa', 'b')
PALM_WORDS = ('hand', 'back', 'palm')
# In a subject besides the side: 'LH', 'HandR'.
HAND_WORDS = re.compile(r'hand|[\W_]|(?<=^[rl])h$')
WORD_OR_CAPITALS_GAP = WORD_GAP + r'|(?<=[A-Z])(?=[A-Z][a-z])'    # behind capitals, too
NUMBERED_DIGITS = {'first': 'thumb', 'second': 'index', 'third': 'middle', 'fourth': 'ring',
                   'fifth': 'little'}
# The side's letter right before or behind: 'rindexdip', 'Rindex_dip', 'IndexMCPR', 'lwrist'.
JOINED_LABEL = re.compile(
    r'([rl]?)(?:(thumb|index|middle|ring|little|pink(?:y|ie))_?(cmc|mcp|pip|dip|ip|tip)|(wrist))'
    r'([rl]?)', re.IGNORECASE)
SIDE_IN_FRONT = re.compile(r'(right|left|r|l)[ _.-]+(.+)')
ROKOKO_FINGER = re.compile(r'finger ([1-5]) ?([a-z]+)')    # the thumb is the first
NUMBERED_LABEL = re.compile(r'|[A-Za-z]?\d+')
# Joint at the beginning of a bone, of fingers and of the thumb.
FINGER_BONES = {'metacarpal': 'cmc', 'mc': 'cmc', 'proximal': 'mcp', 'pp': 'mcp', '1': 'mcp',
                'intermediate': 'pip', 'medial': 'pip', 'mp': 'pip', '2': 'pip',
                'distal': 'dip', 'dp': 'dip', '3': 'dip', 'tip': 'tip', '4': 'tip',
                'mcp': 'mcp', 'pip': 'pip', 'dip': 'dip', 'cmc': 'cmc'}
THUMB_BONES = {'metacarpal': 'cmc', 'mc': 'cmc', '1': 'cmc', 'proximal': 'mcp', 'pp': 'mcp',
               '2': 'mcp', 'distal': 'ip', 'dp': 'ip', '3': 'ip', 'tip': 'tip', '4': 'tip',
               'cmc': 'cmc', 'mcp': 'mcp', 'ip': 'ip'}
# Where a skeleton's thumb has an intermediate bone, as in Unity, its first is the metacarpal.
THUMB_OF_THREE = THUMB_BONES | {'proximal': 'cmc', 'intermediate': 'mcp', 'medial': 'mcp'}


class HandLabel(NamedTuple):
    """A label of a point on a hand.

    Attributes
    ----------
    side : str
        'right', 'left', or empty where the label does not say.
    name : str
        As 'index_pip' or 'back_hand_1'; 'index_middle' is on the middle phalanx.
    """

    side: str
    name: str


def hand_labels(labels: Sequence[str], is_skeleton: bool = False) -> list[HandLabel | None]:
    """Return the point of the hand of each label, None for labels of other things.

    Read are the spellings of `identify`, subjects ('Anna:RIndexTip'), and the joints of skeletons:
    HumanIK, Mixamo, Unity, Xsens, Rokoko, OptiTrack, WebXR, OpenXR, MediaPipe.

    Parameters
    ----------
    labels : sequence of str
    is_skeleton : bool, optional
        Whether these are joints, so that a hand's own name is its wrist.

    Returns
    -------
    list of HandLabel or None
    """
    split = [_split(label) for label in labels]
    thumb = THUMB_OF_THREE if any('thumb' in words and {'intermediate', 'medial'} & set(words)
                                  for _, words in split) else THUMB_BONES
    return [_named(side, words, thumb, is_skeleton) for side, words in split]


def ids_of_both_hands(layout: MarkerLayout) -> HandIds:
    """Return the ids of both hands' markers by names that tell the side, in its namespace.

    Parameters
    ----------
    layout : MarkerLayout
        Of each hand: 'RHand:index', 'R_index', 'Anna:right_index_mcp'.
    """
    known = ids_by_name(layout)

    def find(name: str) -> tuple[str, int] | None:
        readings = spellings(name)
        readings += [(label.side, label.name) for label in hand_labels((name,)) if label]
        whose = _side_of_subject(name)
        return next(((side or whose, known[own]) for side, own in readings
                     if (side or whose) and own in known), None)

    return find


def are_nameless(labels: Iterable[str]) -> bool:
    """Return whether labels name nothing: there are none, or numbers, as 'leds/3', 'Ann:M003'."""
    return all(NUMBERED_LABEL.fullmatch(re.split('[/:]', label)[-1]) for label in labels)


def labels_as_markers(labels: Sequence[str]) -> tuple[str, ...]:
    """Return labels of joints renamed as those of markers: 'right_wrist' for 'RightHand'.

    Parameters
    ----------
    labels : sequence of str

    Returns
    -------
    tuple of str
        Labels with the same meaning for both are unchanged.
    """
    return tuple(
        label if joint is None or joint == marker
        else '_'.join(filter(None, (joint.side, joint.name)))
        for label, joint, marker in zip(labels, hand_labels(labels, True), hand_labels(labels)))


def spellings(label: str) -> list[tuple[str, str]]:
    """Return the possible readings of a label: its side, and its name without the side.

    Parameters
    ----------
    label : str

    Returns
    -------
    list of tuple of str
        Side, empty where the label does not say, and words with underscores: 'Anna:RWristOut' is
        ('right', 'wrist_out'), 'LIDX6' may be ('', 'lidx6') or ('left', 'idx6').
    """
    side, words = _split(label)
    found = [(side, '_'.join(words))]
    own = label.rpartition(':')[2].strip()
    # In capitals the letter of a side may also belong to the name.
    if not side and own.isupper() and len(own) > 1 and own[0].lower() in LABEL_SIDES:
        found.append((LABEL_SIDES[own[0].lower()], '_'.join(_words(own[1:])[1])))
    return found


def literal_spellings(label: str) -> list[tuple[str, str]]:
    """Return readings of a label word for word: the whole, and what is behind a side.

    Parameters
    ----------
    label : str

    Returns
    -------
    list of tuple of str
        Side, empty where none is read, and the rest in small letters: 'Right_r1' is
        ('', 'right_r1') and ('right', 'r1'), 'RHand:r1' is ('right', 'r1').
    """
    own = label.rpartition(':')[2].strip().lower()
    found = [(_side_of_subject(label), own)]
    if match := SIDE_IN_FRONT.fullmatch(own):
        found.append((LABEL_SIDES[match[1]], match[2]))
    return found


def _side_of_subject(label: str) -> str:
    """Return the side that a label's subject names, as 'RHand:tip' or 'Anna:left:tip'; or empty."""
    subject = label.rpartition(':')[0].rpartition(':')[2]
    return LABEL_SIDES.get(HAND_WORDS.sub('', subject.lower()), '')


def _split(label: str) -> tuple[str, list[str]]:
    """Return the side that a label names, and its other words."""
    subject, _, own = label.rpartition(':')
    sides = [side for text in (own, subject) for side in (_words(text)[0],) if side]
    return (sides[0] if sides else ''), _words(own)[1]


def _words(text: str) -> tuple[str, list[str]]:
    side = ''
    joined = JOINED_LABEL.fullmatch(text.strip())
    if joined and not (joined[1] and joined[5]):
        found = [word.lower() for word in joined.group(2, 3, 4) if word]
        return (LABEL_SIDES.get((joined[1] or joined[5]).lower(), ''),
                [SYNONYMS.get(word, word) for word in found])
    # 'RIndex3', 'LHandOut': a capital in front of a word.
    initial = re.match(r'[RL](?=[A-Z][a-z])', text.strip())
    if initial:
        side, text = LABEL_SIDES[initial[0].lower()], text.strip()[1:]
    words = usual_words(text, WORD_OR_CAPITALS_GAP)
    ends = 0, len(words) - 1
    found = []
    for i, word in enumerate(words):
        # One letter is a side in front and behind only; 'hand_left' is a place on the back.
        if (word in LABEL_SIDES and len(words) > 1 and (len(word) > 1 or i in ends)
                and not (found and found[0] in PALM_WORDS)):
            side = side or LABEL_SIDES[word]
        else:
            found.append(word)
    return side, found


def _digits_by_number(words: list[str]) -> list[str]:
    """Return words with 'index', 'proximal' for Rokoko's 'finger', '2proximal'."""
    numbered = ROKOKO_FINGER.fullmatch(' '.join(words))
    if numbered is None:
        return words
    number, bone = numbered.groups()
    return [tuple(NUMBERED_DIGITS.values())[int(number) - 1], bone]


def _named(side: str, words: list[str], thumb: dict[str, str],
           is_skeleton: bool) -> HandLabel | None:
    if words == ['hand', 'wrist']:
        words = ['wrist']
    if is_skeleton and words in (['hand'], ['wrist']):
        return HandLabel(side, 'wrist')
    plain = [NUMBERED_DIGITS.get(word, word) for word in _digits_by_number(words)
             if word not in EMPTY_WORDS]
    # 'RightHandIndex1', 'RightInHandIndex': the hand in front of the digit.
    in_hand = plain[:2] == ['in', 'hand']
    while plain[:1] in (['in'], ['hand']) and len(plain) > 1:
        plain = plain[1:]
    # 'RightHandIndex3_end': the end of the last bone is the tip.
    is_end = is_skeleton and len(plain) == 3 and plain[2] == 'tip'
    if plain and plain[0] in DIGITS and len(plain) - is_end <= 2:
        bones = thumb if plain[0] == 'thumb' else FINGER_BONES
        bone = plain[1] if len(plain) > 1 else 'metacarpal' if in_hand else ''
        place = bones.get(bone, 'middle' if bone == 'middle' else None)
        if place and is_end:
            place = 'tip' if place in ('dip', 'ip', 'tip') else None
        if place:
            return HandLabel(side, f'{plain[0]}_{place}')
    known, = identify(('_'.join(words),)) if words else (None,)
    return HandLabel(side, canonical_name('_'.join(words))) if known else None
