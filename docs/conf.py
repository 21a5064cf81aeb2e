# The documents as a site: `./dev docs`. The source folder is the whole tree, so that a link between Markdown files,
# as ../daemon/README.md, leads to the same page on disk and in the site.
import re
from pathlib import Path

project = "Servotwin"
extensions = ["myst_parser"]
root_doc = "docs/index"
include_patterns = ["docs/**.md", "**/README.md", "README.md", "CHANGELOG.md", "SECURITY.md"]
exclude_patterns = ["build*", ".*", "**/node_modules"]

# Anchors of headings down to the third level, named as GitHub names them.
myst_heading_anchors = 3
highlight_language = "none"  # what a command prints is no program

language = "en"
html_theme = "furo"
html_title = "Servotwin"
html_show_copyright = False
html_copy_source = False
html_show_search_summary = False  # would have to read other files, which a browser forbids a page from file://


def name_page_of_folder(app, page, text):
    """A link to a folder leads to the page in it: [decisions](docs/decisions/) to docs/decisions/index.md."""
    here = Path(app.env.doc2path(page)).parent

    def named(link):
        inside = [name for name in ("index.md", "README.md") if (here / link[1] / name).exists()]
        return f"]({link[1]}{inside[0]})" if inside else link[0]

    text[0] = re.sub(r"\]\(([^():#\s]+/)\)", named, text[0])


def complete_theme(app, problem):
    """What Debian's build of furo leaves out: a script is imported as a module, which a page from file:// may not do; a
    style sheet is imported from a web server; the dark colours are not used where the reader's system is dark."""
    static = Path(app.outdir) / "_static"
    script, style = static / "scripts/furo.js", static / "styles/furo.css"
    text = script.read_text()
    line = 'import Gumshoe from "./gumshoe-patched.js";'
    if text.startswith(line):
        script.write_text((static / "scripts/gumshoe-patched.js").read_text() + text.removeprefix(line))
    text = style.read_text()
    line = "@import url(/javascript/normalize.css/normalize.css);"
    if text.startswith(line):
        text = Path("/usr/share/javascript/normalize.css/normalize.css").read_text() + text.removeprefix(line)
    dark = re.search(r'body\[data-theme="dark"\] (\{.*?\})', text, re.DOTALL)
    if dark and "prefers-color-scheme: dark" not in text:
        text += f'@media (prefers-color-scheme: dark) {{ body[data-theme="auto"] {dark[1]} }}\n'
    style.write_text(text + "code.literal { overflow-wrap: break-word }\n")  # on a narrow screen


def setup(app):
    app.connect("source-read", name_page_of_folder)
    app.connect("build-finished", complete_theme)
