"""The prose of the documentation: at most 25 words a sentence, and none of the words that CONTRIBUTING.md rules out.

Code is not prose: blocks are left out and a code span counts as one word. A cell of a table, an item of a list and a
heading are each a text of their own.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

WORDS_MAX = 25
ROOT = Path(__file__).parents[2]
BANNED = {
    r"lie|lies|lied|lying|liar|liars": "a fault; a faulty sensor; a misbehaving sender; is (between, above)",
    r"accus\w+|acquit\w*|blam\w+|culprit\w*": "the suspect is",
    r"relent\w*|doz\w+|jolt\w*|suspicion\w*|likeness\w*": "the term of the glossary",
    r"hear|hears|heard|overhear\w*|deaf|ear|ears": "receive, reception, receiver outage",
    r"tell|tells|told": "publish, send, report, show",
    r"foreseen|unforeseen|unfelt": "predicted, explained, unexplained",
    r"anew": "again",
    r"whoever|whatever|whomever|whosoever": "name who or what it is",
    r"everybody|everyone|nobody|no-one": "each vehicle, no vehicle",
    r"thereof|therein|whereof|amid|amidst|whilst|lest|ere": "a modern word",
    r"simply|obviously|of course|needless to say": "leave it out",
}
_BANNED = {re.compile(rf"\b(?:{words})\b", re.IGNORECASE): instead for words, instead in BANNED.items()}
_OPENING = re.compile(r"\W*(Who|What)\b")
_FENCE = re.compile(r"^\s*(```|~~~)")
_ITEM = re.compile(r"^\s*(?:[-*+]|\d+[.)])\s+")
_RULE = re.compile(r"^\s*\|?\s*:?-{3,}")
_INVISIBLE = re.compile(r"!\[[^\]]*\]\([^)]*\)|<!--.*?-->|<[^>\n]+>", re.DOTALL)
_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_SPAN = re.compile(r"(`+)(?:.+?)\1", re.DOTALL)
_END = re.compile(r"(?<=[.!?])[\"')*_]*\s+(?=[\"'(*_]*[A-Z0-9§])|\s+·\s+")
_NO_END = re.compile(r"\b(?:[A-Z]|e\.g|i\.e|cf|vs|al|Fig|Eq|Sec|No|approx)\.$")
_WORD = re.compile(r"[^\W_][^\s]*")


class Text(NamedTuple):
    """A paragraph, item, cell or heading, and the line where it begins."""

    line: int
    words: str


def texts(markdown: str) -> Iterator[Text]:
    """Yield the texts of a page, without code."""
    gathered: list[str] = []
    start = 1
    for number, line in enumerate([*_without_blocks(markdown), ""], 1):
        stripped = line.strip()
        if gathered and (not stripped or stripped[0] in "|#" or _ITEM.match(line)):
            yield Text(start, " ".join(gathered))
            gathered = []
        if stripped.startswith("|"):
            yield from (Text(number, cell) for cell in _cells(stripped))
        elif stripped.startswith("#"):
            yield Text(number, stripped.lstrip("# "))
        elif stripped:
            start = start if gathered else number
            gathered.append(_ITEM.sub("", line).strip().lstrip("> "))


def _without_blocks(markdown: str) -> Iterator[str]:
    """Yield the lines of a page, those of a code block empty."""
    fenced = False
    for line in markdown.splitlines():
        fence = bool(_FENCE.match(line))
        fenced ^= fence
        yield "" if fenced or fence else line


def _cells(row: str) -> list[str]:
    return [] if _RULE.match(row) else _SPAN.sub("Code", row).strip("|").split("|")


def sentences(text: str) -> Iterator[str]:
    """Yield the sentences of a text; a code span is the word `Code`, a link its text."""
    plain = _LINK.sub(r"\1", _INVISIBLE.sub(" ", _SPAN.sub("Code", text)))
    start = 0
    for end in _END.finditer(plain):
        if not _NO_END.search(plain[start : end.start()]):
            yield plain[start : end.start()].strip()
            start = end.end()
    yield plain[start:].strip()


def problems(markdown: str) -> Iterator[tuple[int, str]]:
    """Yield each problem of a page with its line."""
    for text in texts(markdown):
        for sentence in sentences(text.words):
            count = len(_WORD.findall(sentence))
            if count > WORDS_MAX:
                yield text.line, f"{count} words: {sentence}"
            if _OPENING.match(sentence) and sentence.endswith("."):
                yield text.line, f"begins with who or what: {sentence}"
            for words, instead in _BANNED.items():
                if found := words.search(sentence):
                    yield text.line, f"'{found[0]}' (write {instead}): {sentence}"


def pages() -> list[Path]:
    """Return the pages that are held to the rules."""
    return [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")] + sorted(
        (ROOT / "docs").rglob("*.md")
    )


def main() -> int:
    """Print every problem; return 1 when there is one."""
    found = [(page, *problem) for page in pages() for problem in problems(page.read_text(encoding="utf-8"))]
    for page, line, problem in found:
        sys.stdout.write(f"{page.relative_to(ROOT)}:{line}: {problem}\n")
    sys.stdout.write(f"{len(found)} problems of prose in {len(pages())} pages\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
