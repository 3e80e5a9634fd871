"""How the pages become a site: `uv run sphinx-build -W -n --keep-going docs site`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

project = "treereg"
author = "The treereg developers"
html_title = "treereg"
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False
language = "en"
highlight_language = "text"

extensions = ["myst_parser", "sphinx.ext.autodoc", "extensions.mathml", "extensions.offline", "extensions.records"]
exclude_patterns = ["extensions"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["formulas.css"]
html_math_renderer = "mathml"

# Docstrings are plain text with names in single backticks.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "BoolArray", "FloatArray", "IntArray")}
add_module_names = False
maximum_signature_line_length = 100
autodoc_default_options = {"members": True, "show-inheritance": True, "exclude-members": "model_config"}
nitpick_ignore_regex = [
    # Other projects' names would need their inventories, and so a network.
    (
        "py:.*",
        r"(numpy|pathlib|collections|abc|enum|pydantic|pandas|scipy|hypothesis|geopandas|shapely|matplotlib|unittest)\..*|Path|Geometry|GeoDataFrame|Axes",
    ),
    # Aliases of arrays keep their names, and lead nowhere.
    ("py:class", "TypeAliasForwardRef|(Array|Bool|Float|Int)(Like|Array)"),
    # What public values hold and no page describes.
    (
        "py:class",
        r"treereg_core\.(image|outlines|pipeline|plan|registry|series\.(history|places)|simulate\.(flight|series))\.\w+|Outlines",
    ),
]
