"""How the documentation is built: ``make docs``, without network; every warning is an error."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

# Tutorials run the command, which lies beside the interpreter that builds, on one thread a process.
os.environ["PATH"] = os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))
os.environ.update(COLUMNS="88", OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

# Their kernels follow nobody's own settings. What they run prints plain text, though a kernel asks for colours, and a
# terminal's cell prints its output as it came, or fails.
profile = Path(tempfile.mkdtemp(prefix="inkjet-docs-"), "profile_default")
(profile / "startup").mkdir(parents=True)
(profile / "ipython_kernel_config.py").write_text("c.IPKernelApp.log_level = 40\n")
shutil.copy(Path(__file__).parent / "_ext" / "kernel_startup.py", profile / "startup")
os.environ["IPYTHONDIR"] = str(profile.parent)
atexit.register(shutil.rmtree, profile.parent, ignore_errors=True)

project = "inkjet-env"
author = "the inkjet-env authors"
project_copyright = "the inkjet-env authors, MIT licence"
version = release = metadata.version("inkjet-env")

extensions = [
    "sphinx.ext.autodoc",
    "numpydoc",
    "myst_nb",
    "command_help",
    "effect_catalogue",
    "line_breaks",
    "mathml",
    "module_map",
    "offline",
    "references",
]
exclude_patterns = ["_ext"]
templates_path = []
nitpicky = True
nitpick_ignore_regex = [
    # Other projects' objects: their inventories would have to be fetched from the network.
    (r"py:.*", r"(?!inkjet_env|optimizers|experiments).*"),
]
default_role = "py:obj"
highlight_language = "text"
show_warning_types = True

html_theme = "pydata_sphinx_theme"
html_title = "inkjet-env"
html_static_path = ["_static"]
html_css_files = ["inkjet.css"]
html_math_renderer = "mathml"
html_sidebars = {"getting-started": [], "gallery": []}  # sections of one page
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "header_links_before_dropdown": 7,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_update_mathjax = False

nb_execution_mode = "force"
nb_execution_raise_on_error = False  # a cell that fails is a warning, so an error here, and the others are still run
nb_execution_show_tb = True
nb_execution_in_temp = True
nb_execution_timeout = 240
nb_output_stderr = "remove"  # progress
nb_ipywidgets_js = {}
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"
toc_object_entries_show_parents = "hide"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
