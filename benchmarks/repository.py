"""Where the repository, its package and its pictures are."""

from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
PACKAGE_FOLDER = REPOSITORY / 'hand_tracker'
PICTURE_FOLDER = REPOSITORY / 'docs' / 'pictures'
