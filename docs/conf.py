"""Sphinx: `sphinx-build -W -n docs build/docs` makes the pages, warnings being errors."""

from npend_gym import __version__

project = "npend_gym"
author = "the npend_gym developers"
project_copyright = f"2026, {author}"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",  # its role "autolink" links what can be linked in docstrings
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
html_theme = "furo"
html_title = f"npend_gym {version}"
exclude_patterns = ["results"]

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence"]
myst_heading_anchors = 3

default_role = "autolink"
autosummary_generate = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say more
autodoc_mock_imports = ["stable_baselines3", "torch"]  # for the pages alone too heavy
napoleon_google_docstring = False
napoleon_use_param = napoleon_use_rtype = False
napoleon_use_ivar = True
napoleon_custom_sections = [
    "Description",
    "Action",
    "Observation",
    "Reward",
    "Success",
    "Starting state",
    "Episode end",
    "Info",
    "Version history",
]

# Names of our own must be found; types in docstrings are words, and nothing is fetched
nitpick_ignore_regex = [("py:.*", r"(?!npend_gym\.).*")]
