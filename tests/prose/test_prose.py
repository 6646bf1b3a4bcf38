"""The checker of prose sees sentences, and only sentences; the documentation has no problem."""

import pytest
from prose.check import problems, sentences, texts

LONG = " ".join(["word"] * 26)


def found(markdown: str) -> list[tuple[int, str]]:
    return [(line, problem.partition(":")[0].partition(" (")[0]) for line, problem in problems(markdown)]


def test_the_documentation_keeps_the_rules_of_prose() -> None:
    from prose.check import pages

    wrong = [(page.name, *one) for page in pages() for one in problems(page.read_text(encoding="utf-8"))]
    assert wrong == []


def test_a_sentence_ends_where_a_reader_ends_it() -> None:
    text = (
        "Y. Wang et al. show 2.5 %. `tick()` ends it (see Fig. 3). Is it so? [A link](https://x.example/a.b) follows."
    )
    assert list(sentences(text)) == [
        "Y. Wang et al. show 2.5 %.", "Code ends it (see Fig. 3).", "Is it so?", "A link follows.",
    ]  # fmt: skip


def test_paragraphs_items_cells_and_headings_are_texts_of_their_own() -> None:
    page = (
        "# Title\nfirst\nsecond\n\n- one\n  more\n- two\n\n"
        "| a | b `x | y` |\n| --- | --- |\n| c | d |\n\n```\n# no\n```\n> said\n"
    )
    assert [(text.line, text.words.strip()) for text in texts(page)] == [
        (1, "Title"), (2, "first second"), (5, "one more"), (7, "two"), (9, "a"), (9, "b Code"), (11, "c"), (11, "d"),
        (16, "said"),
    ]  # fmt: skip


@pytest.mark.parametrize("page", [f"Intro.\n\n{LONG}.", f"Intro.\n\n- {LONG}", f"# A\n\n| short | {LONG} |"])
def test_twenty_six_words_are_too_many(page: str) -> None:
    assert found(page) == [(3, "26 words")]


@pytest.mark.parametrize(
    "page",
    [
        LONG.removesuffix(" word"),
        f"{LONG[:50]}. {LONG[:50]}.",
        f"```\n{LONG}\n```",
        f"`{LONG}` is code",
        f"[one link]({LONG.replace(' ', '/')}) is one",
    ],
)
def test_twenty_five_words_and_code_are_not(page: str) -> None:
    assert found(page) == []


@pytest.mark.parametrize(
    ("text", "word"),
    [("It begins anew.", "'anew'"), ("A LIAR sends.", "'LIAR'"), ("What moves is a car.", "begins with who or what")],
)
def test_words_that_are_ruled_out_are_named(text: str, word: str) -> None:
    assert found(text) == [(1, word)]


@pytest.mark.parametrize("text", ["`liar` is a name.", "The client lives.", "What moves?", "## What moves"])
def test_words_that_look_like_them_are_not(text: str) -> None:
    assert found(text) == []
