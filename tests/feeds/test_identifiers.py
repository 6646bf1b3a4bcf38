import pytest
from hypothesis import given
from hypothesis import strategies as st

from headway.feeds.identifiers import folded, temporary_id
from headway_schemas.keys import is_id


@pytest.mark.parametrize(
    "value",
    [
        "24EF00AB", "24ef00ab", "24 ef 00 ab", "24:EF:00:AB", "24-ef-00-ab", "0x24ef00ab", " 24EF00AB ",
        0x24EF00AB, str(0x24EF00AB), [0x24, 0xEF, 0x00, 0xAB], [0x24, -17, 0, -85],
    ],
)  # fmt: skip
def test_all_spellings_of_four_octets_are_one(value: object) -> None:
    assert temporary_id(value) == "24EF00AB"


@pytest.mark.parametrize(("text", "identifier"), [("4:H95G::", "4~3AH95G~3A~3A"), ("a~b", "a~7Eb"), ("A", "A")])
def test_another_text_keeps_its_letters(text: str, identifier: str) -> None:
    assert temporary_id(text) == identifier


@pytest.mark.parametrize("value", [None, True, 1.5, {}, [1, 2, 3], [1, 2, 3, 256], 2**32])
def test_another_value_is_left_to_the_model(value: object) -> None:
    assert temporary_id(value) is value


OCTETS = st.integers(0, 2**32 - 1)


@given(OCTETS, OCTETS)
def test_it_is_injective_on_octets(one: int, other: int) -> None:
    for spell in (str, "{:08x}".format, lambda n: list(n.to_bytes(4, "big"))):
        assert (temporary_id(spell(one)) == temporary_id(other)) is (one == other) or spell is str


@given(st.text(min_size=1, max_size=9), st.text(min_size=1, max_size=9))
def test_texts_that_differ_stay_apart(one: str, other: str) -> None:
    def octets(text: str) -> bool:
        return temporary_id(text) == temporary_id(text).upper() and len(temporary_id(text)) == 8

    same = temporary_id(one) == temporary_id(other)
    assert not same or one.strip() == other.strip() or (octets(one) and octets(other))


@given(st.text(min_size=1, max_size=5))
def test_it_is_an_identifier(text: str) -> None:
    assert not text.strip() or is_id(temporary_id(text))


@given(OCTETS)
def test_the_sender_of_a_key_is_folded_alike(octets: int) -> None:
    assert folded(f"{octets:08x}") == temporary_id(octets)
    assert folded("gw-24ef00ab") == "gw-24ef00ab"
