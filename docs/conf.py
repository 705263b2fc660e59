# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sphinx configuration; rosdoc2 and `sphinx-build docs OUT` read it. Needs myst-parser."""

project = "valve_twin"
author = copyright = "valve_twin maintainers"
extensions = ["myst_parser"]
myst_heading_anchors = 3
exclude_patterns = [
    "campaigns",
    # what rosdoc2 adds: a second front page, and a page for each module of the package
    "__readme_include.rst",
    "index.rst",
    "modules.rst",
    "valve_twin*.rst",
]
html_theme = "alabaster"
html_static_path = ["images"]
suppress_warnings = [
    "myst.xref_missing",  # links to files of the package, outside of these pages
    "toc.not_included",  # the change log and its like are rosdoc2's pages; a test counts ours
]
