"""What the site does differently from the pages as GitHub shows them: formulas as MathML, which needs no script and no
network, and links to source files as plain names.
"""

import html
import re
from typing import Any

from latex2mathml.converter import convert

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
LINK_TO_SOURCE = re.compile(r"\[([^\]]*)\]\(\.\./(?:src|reproduction|benchmarks|examples)/[^)]*\)")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by mkdocs with the source of each page."""
    return LINK_TO_SOURCE.sub(r"`\1`", markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Called by mkdocs with the HTML of each page."""
    return FORMULA.sub(_as_mathml, content)


def _as_mathml(formula: re.Match[str]) -> str:
    tag, bracket, latex = formula.groups()
    return f"<{tag}>{convert(html.unescape(latex).strip(), display='block' if bracket == '[' else 'inline')}</{tag}>"
