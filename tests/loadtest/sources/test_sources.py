import pytest

from headway_loadtest.sources import SourceError, parse_sources
from headway_loadtest.sources.pairs import COLUMNS


def parse(*words):
    return parse_sources([str(word) for word in words], seconds=2.0, seed=1)


def test_synthetic_and_pairs_together(tmp_path):
    pair = tmp_path / "pair.csv"
    pair.write_text(",".join(COLUMNS) + "\n0,30,10,5,5,4\n0.1,30.5,10.5,5,5,4\n")
    scenes = list(parse("synthetic:3", pair))
    assert [len(scene) for scene in scenes] == [3, 2]


def test_a_source_can_be_read_again():
    source = parse("synthetic:3")
    assert len(list(source)) == len(list(source)) == 1


@pytest.mark.parametrize(
    ("word", "problem"),
    [
        ("synthetic:", "write synthetic:N"),
        ("synthetic:-3", "write synthetic:N"),
        ("synthetic:0", "write synthetic:N"),
        ("nowhere.csv", "no such file or folder"),
    ],
)
def test_bad_words_are_named(word, problem):
    with pytest.raises(SourceError, match=problem) as caught:
        parse(word)
    assert word in str(caught.value)


def test_no_words():
    with pytest.raises(SourceError, match="no source"):
        parse()


def test_a_folder_without_tables(tmp_path):
    (tmp_path / "other.csv").write_text("a\n")
    with pytest.raises(SourceError, match=r"no \*DataWsu\*\.csv"):
        parse(tmp_path)


def test_a_folder_of_genuine_tables(shared_data):
    vehicles = [drive.vehicle for scene in parse(shared_data / "spmd_fixtures") for drive in scene]
    assert len(vehicles) == len(set(vehicles)) == 4
