"""What the pages of the site have beyond mkdocs: the reference of the headers in the navigation, and the anchors of
headings as code hosts make them."""

import re

from mkdocs.structure.nav import Link


def slug(text, separator):
    """Anchor of a heading: lower case, without punctuation, each blank a hyphen."""
    return re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", separator)


def on_config(config):
    config["mdx_configs"].setdefault("toc", {})["slugify"] = slug
    return config


def on_nav(nav, config, files):
    """Doxygen writes the reference into the site, where mkdocs would look for it in vain."""
    del config, files
    link = Link("Reference of the headers", "api/index.html")
    library = next(item for item in nav.items if item.title == "The library")
    library.children.append(link)
    link.parent = library
    return nav
