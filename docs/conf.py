"""Sphinx: the pages of this folder, and the reference of the public API from its docstrings."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ['HAND_TRACKER_JIT'] = '0'

from hand_tracker import __version__  # noqa: E402

project = 'hand_tracker'
author = 'hand_tracker maintainers'
release = version = __version__

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.autosummary',
              'sphinx.ext.napoleon']
source_suffix = {'.md': 'markdown', '.rst': 'restructuredtext'}
exclude_patterns = ['_build']
myst_heading_anchors = 3
napoleon_google_docstring = False
napoleon_use_ivar = True
autodoc_typehints = 'description'
autodoc_member_order = 'bysource'
autosummary_generate = True
# What the documented modules import besides numpy and PyYAML.
autodoc_mock_imports = ['matplotlib', 'rosbags', 'scipy']
html_theme = 'alabaster'
html_theme_options = {'description': 'Optical markers in, 25 joint angles out',
                      'page_width': '1100px'}
