"""How Sphinx makes a site of these pages: `make docs`."""

import re

project = "echolearn"
author = "the echolearn contributors"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "echolearn"
html_show_sphinx = False
html_static_path = ["site.css"]
html_css_files = ["site.css"]
exclude_patterns = ["**/.ipynb_checkpoints"]

# Notebooks are shown as they were executed; a test executes them.
nb_execution_mode = "off"
nb_merge_streams = True
myst_heading_anchors = 4
# Names in docstrings stand between single backticks.
default_role = "literal"
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_use_ivar = True


def name_files(app, name, source):  # noqa: ARG001  # as Sphinx calls it
    """Name files of the repository that are no pages, instead of linking to them."""
    if "/" in name:
        return
    text = re.sub(r"\[[^]]+\]\(\.\./([^)]+)\)", r"`\1`", source[0])
    # Anchors as GitHub wants them, which MyST calls targets.
    source[0] = re.sub(r'^<a id="([^"]+)"></a>', r"(\1)=\n", text, flags=re.M)


def setup(app):
    """Tell Sphinx."""
    app.connect("source-read", name_files)
