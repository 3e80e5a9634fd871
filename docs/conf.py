"""How the pages become a site: `uv run sphinx-build -W -n --keep-going docs site`."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project = "treereg"
author = "The treereg developers"
html_title = "treereg"
html_copy_source = False
html_show_sphinx = False
language = "en"

extensions = ["myst_parser", "sphinx.ext.autodoc", "extensions.mathml", "extensions.offline"]
exclude_patterns = ["extensions"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

html_theme = "furo"
html_math_renderer = "mathml"

# Docstrings are plain text with names in single backticks.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_class_signature = "separated"
# Other projects' names would need their inventories, and so a network.
nitpick_ignore_regex = [
    ("py:.*", r"(numpy|pathlib|collections|abc|enum|pydantic|pandas|scipy|hypothesis)\..*"),
    ("py:class", "FloatArray"),
]
