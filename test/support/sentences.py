"""A rough filter for sentences that readers stumble over, in docstrings, comments and Markdown.

It knows shapes, not meaning: a flagged sentence may be good, and an unflagged one bad.
"""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

OPENING = re.compile(
    r"^(what|whatever|whoever|whose|whom|who|of|by which|by how|by what|with which|from which|in which|"
    r"to which|as far as|how (?:much|many|far|long|often|large|well)|where it|so (?:much|many))\b",
    re.IGNORECASE,
)
MOST_WORDS = 30
WORDS = (  # private or vague, where the field has a term
    "somebody|nobody|everybody|whoever|anew|of late|besides|so many|tells|told|lasts|by itself|takes for|"
    "gives up|what is left|comes back|as it is|news|in place of|goes on|at most so|all that"
)
WORD = re.compile(rf"\b({WORDS})\b", re.IGNORECASE)
NO_VERB = set(  # first words of function docstrings that are not imperative
    "the a an what whether how of where which who whom whose when by in on all every one its their as and "
    "from for to if that those this these some no nothing both each".split()
)


def faults(text: str, of_function: bool = False) -> list[str]:
    """Return the names of the faults of a text."""
    found = []
    first = re.match(r"[A-Za-z']+", text)
    if of_function and first and first.group(0).lower() in NO_VERB:
        found.append("summary")
    plain = re.sub(r"\s+", " ", re.sub(r"``?[^`]*``?", "X", text)).strip()
    for sentence in re.split(r"(?<=[.!?:;])\s+(?=[A-Z(*])", plain):
        if re.search(r"[a-z]{3}", sentence):
            found += ["opening"] * bool(OPENING.match(sentence))
            found += ["long"] * (len(re.findall(r"[A-Za-z][A-Za-z'-]*", sentence)) > MOST_WORDS)
            found += ["word"] * len(set(WORD.findall(sentence)))
    return found


def python_texts(source: str) -> Iterator[tuple[str, bool]]:
    """Yield docstrings and comments, and whether each is the docstring of a function."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            text = ast.get_docstring(node)
            if text:
                yield text, isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and not re.match(r"#\s*(type:|noqa|!|fmt:|pragma)", token.string):
            yield token.string.lstrip("# "), False


def markdown_texts(source: str) -> Iterator[tuple[str, bool]]:
    """Yield the lines and table cells of a page outside of code."""
    for line in map(str.strip, re.sub(r"```.*?```", "", source, flags=re.DOTALL).splitlines()):
        if line.startswith("|"):
            yield from ((cell.strip(), False) for cell in line.strip("|").split("|"))
        elif line and not line.startswith(("#", "!", "<")):
            yield re.sub(r"^[-*]\s+|\[([^\]]*)\]\([^)]*\)", r"\1", line), False


def flagged(paths: list[Path]) -> int:
    """Return the number of texts with a fault in files."""
    count = 0
    for path in paths:
        texts = python_texts if path.suffix == ".py" else markdown_texts
        count += sum(bool(faults(*text)) for text in texts(path.read_text()))
    return count
