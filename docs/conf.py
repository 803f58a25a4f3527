"""Sphinx's configuration of the site: sphinx-build -W --keep-going -j 2 docs docs/_build."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

from stepdiag_ros import __version__  # noqa: E402

project = "stepdiag_ros"
copyright = "the authors of stepdiag_ros, Apache-2.0"
release = version = __version__

extensions = ["myst_parser", "stepdiag_site"]
exclude_patterns = ["_build", "examples", "stepdiag_site", "**/README.md"]
myst_enable_extensions = ["colon_fence", "fieldlist", "attrs_block"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

# Everything is read from the pages' own host: no fonts, scripts or pictures from elsewhere.
html_theme = "furo"
html_title = f"stepdiag_ros {__version__}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
python_use_unqualified_type_names = True
add_module_names = False
toc_object_entries = False
highlight_language = "text"
smartquotes = False
