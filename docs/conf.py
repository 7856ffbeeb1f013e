"""How Sphinx builds these pages: `make docs`."""

from vrbench import __version__

project = "vrbench"
author = "The vrbench developers"
release = version = __version__
extensions = ["myst_parser"]
html_theme = "furo"
html_title = f"vrbench {version}"
html_copy_source = False
html_show_copyright = False
exclude_patterns = ["_build"]
myst_heading_anchors = 3
nitpicky = True
