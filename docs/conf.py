"""Sphinx's settings: `make docs` builds the site into out/site, with warnings as errors."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # environments are drawn without a window
# In a checkout that is not installed the packages are found here.
sys.path[:0] = [str(HERE.parent / part) for part in ("docs/site", ".", "envs", "planners")]

import site_api  # noqa: E402
import site_environments  # noqa: E402
import site_links  # noqa: E402
from sphinx.application import Sphinx  # noqa: E402

import ambinav  # noqa: E402

project = "ambinav"
author = "The ambinav authors"
version = release = ambinav.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["site"]
default_role = "literal"  # docstrings mark code as Markdown does
highlight_language = "none"  # of indented blocks: commands and formulas

nb_execution_mode = "off"  # notebooks are shown as `make notebooks` stored them
nb_merge_streams = True
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}
napoleon_use_ivar = True
napoleon_attr_annotations = False  # docutils takes the name numpy.str_ for a link

html_theme = "pydata_sphinx_theme"
html_title = f"ambinav {version}"
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": False, "show_toc_level": 2}


def setup(app: Sphinx) -> None:
    """Make the generated pages before Sphinx looks for pages, and set links right as it reads."""
    site_links.copy_pages()
    site_environments.write_pages()
    site_api.write_pages()
    app.connect("source-read", _relink)


def _relink(app: Sphinx, name: str, source: list[str]) -> None:
    path = app.env.doc2path(name)
    if path.suffix == ".md" and not name.startswith("_generated/"):
        source[0] = site_links.relink(source[0], path)
