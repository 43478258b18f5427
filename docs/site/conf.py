"""Configuration of the documentation site, which scripts/docs builds: it sets the environment and links the sources."""
import os
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HAS_API = os.environ["HELIX_ARM_SITE"] == "html"
# Of a header; without its namespaces, which would be declared anew by each.
SECTIONS = "briefdescription detaileddescription innerclass typedef enum func var public-type public-func public-attrib " \
    "public-static-func public-static-attrib"

project = "helix_arm"
author = "the helix_arm authors"
release = version = re.search("<version>(.*)</version>", (ROOT / "package.xml").read_text(encoding="utf-8")).group(1)
extensions = ["myst_parser"] + ["breathe", "sphinx.ext.autodoc"] * HAS_API
source_suffix = {".rst": "restructuredtext", ".md": "markdown"}
exclude_patterns = ["config", "docs/site", "examples", "include"]
html_theme = "sphinx_rtd_theme"
html_copy_source = False
myst_heading_anchors = 4
highlight_language = "none"  # most examples are what a terminal shows
suppress_warnings = ["duplicate_declaration.cpp", "myst.header"]  # overloads; the heading in the README's box
breathe_projects = {"helix_arm": os.environ["HELIX_ARM_DOXYGEN"]}
breathe_default_project = "helix_arm"
autodoc_typehints = "description"
autodoc_member_order = "bysource"


def heading(text, line="="):
    return "%s\n%s\n\n" % (text, line * len(text))


def write_api(folder):
    """Pages of the command and of the messages, and for each layer of the library and the Python package."""
    folder.mkdir()
    text = heading("Options of the command") + ".. literalinclude:: ../docs/cli_reference.txt\n"
    (folder / "command.rst").write_text(text, encoding="utf-8")
    text = heading("Messages, services and actions")
    for file in sorted(path for kind in ("msg", "srv", "action") for path in (ROOT / kind).iterdir()):
        text += heading(file.name, "-") + ".. literalinclude:: ../%s\n\n" % file.relative_to(ROOT)
    (folder / "messages.rst").write_text(text, encoding="utf-8")
    if not HAS_API:
        return
    (folder / "python.rst").write_text(heading("Python") + ".. automodule:: helix_arm\n   :members:\n", encoding="utf-8")
    for layer in sorted(path for path in (ROOT / "include/helix_arm").iterdir() if path.is_dir()):
        text = heading("C++: " + layer.name)
        for header in sorted(layer.glob("*.hpp")):
            name = "helix_arm/%s/%s" % (layer.name, header.name)
            text += heading(name, "-") + ".. doxygenfile:: %s\n   :sections: %s\n\n" % (name, SECTIONS)
        (folder / ("cpp_%s.rst" % layer.name)).write_text(text, encoding="utf-8")


def list_others(_, name, source):
    """Puts the pages of docs that docs/site/index.rst does not name behind those that it does."""
    if name == "index":
        pages = ["docs/" + page.stem for page in sorted((ROOT / "docs").glob("*.md"))]
        source[0] = source[0].replace("@OTHERS@", "\n   ".join(page for page in pages if page + "\n" not in source[0]))


def setup(app):
    write_api(Path(app.srcdir) / "api")
    app.connect("source-read", list_others)
