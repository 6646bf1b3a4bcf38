import pytest

from headway_loadtest.inject.faults import Kind, Spec, SpecError
from headway_loadtest.inject.spec import parse_spec


def test_nothing_given_is_algorithm_1():
    assert parse_spec("") == Spec(c=1.0, p=0.005, kinds=(Kind.NOISE, Kind.BIAS, Kind.DRIFT), samples=(1, 20), share=1.0)


def test_everything_given():
    spec = parse_spec("c=0.5, p=0.01, kinds=miss+feigned-brake+miss, d=3..7, share=0.25")
    assert spec == Spec(c=0.5, p=0.01, kinds=(Kind.MISS, Kind.FEIGNED_BRAKE), samples=(3, 7), share=0.25)


def test_one_duration():
    assert parse_spec("d=5").samples == (5, 5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("c", "'c' must be written key=value"),
        ("c=x", "c must be a number, not 'x'"),
        ("c=-1", "c is a variance and must be above 0, not -1"),
        ("c=nan", "c is a variance and must be above 0, not nan"),
        ("c=inf", "c is a variance"),
        ("p=2", "p is a probability per sample, between 0 and 1, not 2"),
        ("share=-0.1", "share is the part of the vehicles"),
        ("kind=noise", "'kind' is not a key of an injection; did you mean 'kinds'"),
        ("colour=red", "choose from c, p, kinds, d, share"),
        ("kinds=nois", "'nois' is not a kind of anomaly; did you mean 'noise'"),
        ("kinds=", "'' is not a kind of anomaly"),
        ("kinds=none", "'none' is not a kind of anomaly"),
        ("d=3..1", "d is a range of samples such as 1..20, not 3..1"),
        ("d=0..4", "d is a range of samples"),
        ("d=a..b", "d must be a range of samples such as 1..20, not 'a..b'"),
        ("c=1,c=2", "'c' is given twice"),
    ],
)
def test_errors_are_one_line_that_names_the_word(text, message):
    with pytest.raises(SpecError) as caught:
        parse_spec(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
