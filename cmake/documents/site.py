#!/usr/bin/env python3
"""Gathers the pages of the site, and checks what is made of them.

site.py gather PROJECT FOLDER: copies the documents and all files that they link to, in the folders of the project.
site.py check PROJECT SITE: ends with 1 where a link or an anchor of a page is broken, where a page asks for anything of the
network, or where a table or a list of a document did not become one.
"""

import html.parser
import pathlib
import re
import shutil
import sys
import urllib.parse

LINK = re.compile(r"\]\(([^)\s]+)\)")
FENCE = re.compile(r"^\s*```")


def documents(project):
    """Paths of the documents from the project's folder."""
    names = ["README.md", "CHANGELOG.md", "SECURITY.md", "lib/README.md", "samples/README.md", "samples/LICENSES.md"]
    return [pathlib.Path(name) for name in names] + sorted(
        path.relative_to(project) for path in (project / "docs").glob("*.md"))


def parted(text):
    """Lines, and whether each stands in a block of code."""
    inside = False
    for line in text.split("\n"):
        fence = FENCE.match(line)
        yield line, inside or bool(fence)
        inside ^= bool(fence)


def for_mkdocs(text):
    """Python's Markdown indents what belongs to the item of a list by four blanks, code hosts by two."""
    lines = []
    in_list = False
    for line, code in parted(text):
        if re.match(r"(-|\d+\.) ", line) and not code:
            in_list = True
        elif line and not line.startswith(" ") and not code:
            in_list = False
        blanks = len(line) - len(line.lstrip(" "))
        lines.append(" " * blanks + line if in_list and blanks else line)
    return "\n".join(lines)


def gather(project, folder):
    shutil.rmtree(folder, ignore_errors=True)
    pages = documents(project)
    for page in pages:
        text = (project / page).read_text(encoding="utf-8")
        target = folder / page
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(for_mkdocs(text), encoding="utf-8")
        for link in LINK.findall(text):
            address = urllib.parse.urlsplit(link)
            if address.scheme or not address.path:
                continue
            linked = (project / page.parent / address.path).resolve()
            if not linked.is_relative_to(project.resolve()):
                sys.exit(f"{page}: the link {link} leads out of the project")
            inside = linked.relative_to(project.resolve())
            if inside in pages:
                continue
            if linked.is_dir():
                shutil.copytree(linked, folder / inside, dirs_exist_ok=True)
            elif linked.is_file():
                (folder / inside).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(linked, folder / inside)


class Page(html.parser.HTMLParser):
    """What a page links to, loads and names, and how many tables and items it has."""

    def __init__(self, path):
        super().__init__(convert_charrefs=True)
        self.links, self.loads, self.anchors = [], [], set()
        self.counts = {"table": 0}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        for name in ("id", "name"):
            if values.get(name):
                self.anchors.add(values[name])
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        if tag == "link" and values.get("href") and values.get("rel") not in ("canonical", "next", "prev"):
            self.loads.append(values["href"])
        if tag in ("script", "img", "iframe", "source") and values.get("src"):
            self.loads.append(values["src"])
        if tag in self.counts:
            self.counts[tag] += 1


def tables(text):
    """Number of the tables of a document."""
    lines = list(parted(text))
    return sum(1 for line, code in lines if not code and re.match(r"\s*\|[\s:|-]*-[\s:|-]*\|$", line))


def check(project, site):
    problems = []
    pages = {path: Page(path) for path in sorted(site.rglob("*.html"))}
    for path, page in pages.items():
        where = path.relative_to(site)
        for link in page.links + page.loads:
            address = urllib.parse.urlsplit(link)
            if address.scheme or address.netloc:
                if link in page.loads and address.scheme not in ("data", "javascript"):
                    problems.append(f"{where} loads {link} from the network")
                continue
            target = path if not address.path else (path.parent / urllib.parse.unquote(address.path)).resolve()
            if not target.exists():
                problems.append(f"{where} links to {link}, which is not there")
            elif address.fragment and target in pages and not where.parts[0] == "api":
                if urllib.parse.unquote(address.fragment) not in pages[target].anchors:
                    problems.append(f"{where} links to {link}, which has no such anchor")
    for style in site.rglob("*.css"):
        for address in re.findall(r"url\(['\"]?(https?:)?//", style.read_text(encoding="utf-8", errors="replace")):
            problems.append(f"{style.relative_to(site)} loads {address}// from the network")
    for document in documents(project):
        name = "index.html" if document.name == "README.md" else document.stem + ".html"
        page = pages.get((site / document.parent / name).resolve()) or pages.get(site / document.parent / name)
        if page is None:
            problems.append(f"{document} has no page")
            continue
        wanted = tables((project / document).read_text(encoding="utf-8"))
        if page.counts["table"] != wanted:
            problems.append(f"{document} has {wanted} tables, its page {page.counts['table']}")
    for problem in problems:
        print(f"site.py: error: {problem}", file=sys.stderr)
    print(f"{len(pages)} pages, {sum(len(page.links) for page in pages.values())} links")
    return 1 if problems else 0


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in ("gather", "check"):
        sys.exit(__doc__)
    project, folder = pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3]).resolve()
    if sys.argv[1] == "gather":
        gather(project, folder)
        return 0
    return check(project, folder)


if __name__ == "__main__":
    sys.exit(main())
