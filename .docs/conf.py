"""The site of the guide that `make docs` builds: pages as they are on disk, README as the front page, no network."""

import inspect
import json
import re
import tomllib
from contextlib import contextmanager
from pathlib import Path

import automarine_cli
from automarine_cli import guide
from automarine_cli.commands import automarine, click
from automarine_cli.commands.command import Command
from automarine_cli.guide.search import Index, Section

ROOT = Path(__file__).resolve().parent.parent
PAGES = {
    "index": ROOT / "README.md",
    **{path.relative_to(guide.FOLDER).with_suffix("").as_posix(): path for path in sorted(guide.FOLDER.rglob("*.md"))},
    "python-reference": ROOT / ".docs" / "python-reference.md",
    **{f"notebooks/{path.stem}": path for path in sorted((ROOT / ".docs" / "notebooks").glob("*.md"))},
    **{path.stem.lower(): path for path in sorted((ROOT / ".github").glob("*.md"))},
}  # by their places in the site
POINTER = re.compile(r"^`automarine [a-z-]+ --help`.* lists? all options\.$", flags=re.MULTILINE)
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"].get("urls", {})

project, release, root_doc = "automarine", automarine_cli.__version__, "index"
extensions = ["myst_nb", "sphinx.ext.autodoc"]
myst_enable_extensions = ["attrs_block", "dollarmath", "html_image"]
myst_fence_as_directive, myst_heading_anchors = ["math"], 4
myst_disable_syntax = ["myst_line_comment", "myst_block_break", "myst_target"]  # a line may begin with "% of"
nb_execution_mode, nb_execution_raise_on_error, nb_execution_in_temp = "force", True, True
nb_execution_timeout, nb_number_source_lines = 600, False
html_theme, html_title = "furo", f"automarine {release}"
html_static_path, html_css_files = ["site.css", "search.js"], ["site.css"]
templates_path, html_additional_pages = ["."], {"search": "search.html"}
html_baseurl = URLS.get("Documentation", "")
html_math_renderer, autodoc_typehints, add_module_names = "mathml", "none", False
html_use_index = html_domain_indices = html_copy_source = html_show_copyright = smartquotes = False
nitpick_ignore_regex = [("py:.*", ".*")]  # types that have no page here


def navigation() -> dict[str, dict[str, str]]:
    """Pages by the headings of contents.md under which they are linked first, with what the menu calls them."""
    menu, names = dict[str, dict[str, str]](), {path: name for name, path in PAGES.items()}
    for section in re.split(r"^## ", PAGES["contents"].read_text("utf-8"), flags=re.MULTILINE)[1:]:
        heading, _, body = section.partition("\n")
        menu[heading] = {}
        for words, link in re.findall(r"\[([^]]+)\]\(([^)#]+\.md)", body):
            name = names.get((guide.FOLDER / link).resolve())  # none of a broken link, which has its own warning
            if name and not any(name in pages for pages in menu.values()):
                menu[heading][name] = short_title(name, words)
    menu.setdefault("Reference", {})["python-reference"] = "Python reference"
    return menu


def short_title(name: str, words: str = "") -> str:
    """The page's title up to the colon, or what contents.md calls it where that is shorter."""
    title = re.search("^# (.*)", PAGES[name].read_text("utf-8"), re.MULTILINE)[1].replace("`", "").partition(":")[0]
    if name.startswith("commands/"):
        return title.removeprefix("automarine ")
    return min(title, (words[:1].upper() + words[1:]).replace("`", "") or title, key=len)


def menus() -> str:
    made = "\n```{toctree}\n:hidden:\n\nAll pages <contents>\n```\n"
    for heading, pages in navigation().items():
        addresses = URLS.items() if heading == "Project" else ()
        entries = "\n".join(f"{title} <{place}>" for place, title in [*pages.items(), *((u, t) for t, u in addresses)])
        made += f"\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n{entries}\n```\n"
    return made


def escaped(text: str) -> str:
    return re.sub(r"([\\`*_{}<>|$\[\]])", r"\\\1", text)


class Groups(list):
    """The rows of a table of options: what a command writes into its help."""

    @contextmanager
    def section(self, name):
        self.append(f"| **{name}** | | |")
        yield

    def write_dl(self, options):
        for flags, text in options:
            said, _, limits = escaped(text.replace("]  [", "; ")).partition(r"  \[")
            limits = limits.removesuffix(r"\]").removeprefix("default: ")
            code = ", ".join(f"`{flag}`".replace("|", r"\|") for flag in flags.split(", "))
            words = re.sub(r"(?<![\w-])--?[a-z-]+", r"`\g<0>`", f"{said} | {limits}")
            self.append(f"| {code} | {words} |")


def options(name: str) -> str:
    """A table of options for each command that a page is about."""
    group, made = click.Context(automarine, info_name="automarine", **automarine.context_settings), ""
    for called in re.findall(r"[a-z-]+", short_title(name)):
        command, rows = automarine.get_command(group, called), Groups()
        context = click.Context(command, parent=group, info_name=called)
        command.format_options(context, rows)
        made += f"```text\n{command.get_usage(context).removeprefix('Usage: ')}\n```\n\n{{.options .stacked}}\n"
        made += "\n".join(["| option | meaning | default, limits |", "|---|---|---|", *rows, "\n"])
    return made


def functions() -> str:
    offered = [name for name in automarine_cli.__all__ if name not in ("__version__", "effects")]
    listed = "\n".join(f".. autofunction:: automarine_cli.{name}" for name in offered)
    effects = ".. automodule:: automarine_cli.effects\n   :members: get, names, register"
    sections = (("Commands", listed), ("The library of effects", effects))
    return "".join(f"\n## {title}\n\n```{{eval-rst}}\n{body}\n```\n" for title, body in sections)


def complete(app, name, source):
    """What a page has only here: the menu, the functions, and options in place of the line that points to them."""
    added = {"index": menus, "python-reference": functions}.get(name, str)()
    text = re.sub(r"^\|message\|", r"{.stacked}\n\g<0>", source[0], flags=re.MULTILINE)
    source[0] = POINTER.sub(lambda pointer: options(name), text) + added


def signature(app, kind, name, thing, *rest):
    """The settings of a command, and what they are where they are not given."""
    if not isinstance(thing, Command):
        return None
    plain, empty = inspect.signature(thing), inspect.Parameter.empty
    return str(
        plain.replace(
            parameters=[one.replace(annotation=empty) for one in plain.parameters.values()], return_annotation=empty
        )
    ), ""


def docstring(app, kind, name, thing, settings, lines):
    """What `help()` says of a command: what it does, its settings, what it returns."""
    if isinstance(thing, Command):
        code = re.split(r"(`[^`]+`)", thing.__doc__)
        code[::2] = [escaped(text).replace(r"\*\*", "**") for text in code[::2]]
        code[1::2] = [f"`{part}`" for part in code[1::2]]
        lines[:] = "".join(code).splitlines()


def as_mathml(visitor, node):
    from docutils import nodes
    from docutils.utils.math import MathError
    from docutils.utils.math.latex2mathml import tex2mathml
    from sphinx.util.logging import getLogger

    block, made = isinstance(node, nodes.math_block), ""
    try:
        made = tex2mathml(node.astext(), as_block=block).replace('<mover accent="true">', "<mover>")
    except MathError as problem:
        getLogger(__name__).warning("%s in %s", problem, node.astext(), location=node)
    made = re.sub(r"<mo([^>]*)>([|/])<", r'<mo\1 lspace="0" rspace="0">\2<', made)
    made = re.sub(r"<mo>&ApplyFunction;</mo>(?!\s*(<mrow>\s*)?<mo[^>]*>\()", '<mspace width="0.17em"/>', made)
    visitor.body.append(f'<div class="math">{made}</div>' if block else made)
    raise nodes.SkipNode


def full_size(app, tree):
    """Every picture leads to itself, for screens on which it is small."""
    from docutils.nodes import image

    for picture in tree.findall(image):
        picture.setdefault("scale", 100)


def sections(name, tree):
    """What a page says under each heading, and each row of a table and entry of a glossary by itself."""
    from docutils import nodes
    from sphinx.addnodes import desc

    def lines(part):
        for child in part.children:
            if isinstance(child, nodes.section | nodes.title | nodes.thead | nodes.Invisible | nodes.Text):
                continue
            if isinstance(child, nodes.row):
                cells = [" ".join(cell.astext().split()) for cell in child.children]
                rows.append(Section(name, heading, " | ".join(cells), anchor, next(filter(None, cells), "")))
            elif isinstance(child, desc):
                said = "\n".join(each.astext() for each in child.findall(nodes.paragraph))
                rows.append(Section(name, child[0]["fullname"], said, child[0]["ids"][0]))
            elif isinstance(child, nodes.list_item) and isinstance(
                subject := child.next_node(nodes.Inline), nodes.strong
            ):
                rows.append(Section(name, heading, " ".join(child.astext().split()), anchor, subject.astext()))
            elif isinstance(child, nodes.literal_block):
                yield child.astext()
            elif isinstance(child, nodes.TextElement):
                yield " ".join(child.astext().split())
            else:
                yield from lines(child)

    for section in tree.findall(nodes.section):
        heading, anchor, rows = section.next_node(nodes.title).astext(), section["ids"][0], []
        text = "\n".join(lines(section))
        yield from (Section(name, heading, text, anchor), *rows)


def write_index(app, problem):
    """Write what the search of the site needs."""
    if problem is None:
        pages = [name for name in PAGES if name not in ("index", "contents")]
        index = Index([section for name in pages for section in sections(name, app.env.get_doctree(name))])
        titles = {name: app.env.titles[name].astext() for name in pages}
        data = json.dumps({"titles": titles, **index.plain()}, ensure_ascii=False, separators=(",", ":"))
        Path(app.outdir, "_static", "search-index.js").write_text(f"const searchIndex = {data};\n", encoding="utf-8")


def without_search(app):
    """The search of Sphinx ranks by the alphabet; ours takes its place."""
    app.builder.search = False


def discover(self, *patterns):
    """Find the pages where they are on disk, so that links between them hold as they are written."""
    self._docname_to_path = {name: path.relative_to(self.srcdir) for name, path in PAGES.items()}
    self._path_to_docname = {path: name for name, path in PAGES.items()}
    self.docnames = set(PAGES)
    return self.docnames


def setup(app):
    from sphinx.project import Project

    Project.discover = discover
    app.add_html_math_renderer("mathml", inline_renderers=(as_mathml, None), block_renderers=(as_mathml, None))
    app.connect("builder-inited", without_search)
    app.connect("build-finished", write_index)
    app.connect("source-read", complete)
    app.connect("doctree-read", full_size)
    app.connect("autodoc-process-signature", signature)
    app.connect("autodoc-process-docstring", docstring)
