import pytest

from headway_schemas import Keys
from headway_schemas.keys import Address, has_wildcard, is_gateway, is_id, sanitise_id

KEYS = Keys("v2x", "rsu-7")


def test_every_key_of_the_design() -> None:
    assert KEYS.bsm("veh-1") == "v2x/rsu-7/bsm/veh-1"
    assert KEYS.alert("bias", "veh-1") == "v2x/rsu-7/alert/bias/veh-1"
    assert KEYS.pair_state("veh-1") == "v2x/rsu-7/pair/veh-1/state"
    assert KEYS.rejected("out_of_range") == "v2x/rsu-7/rejected/out_of_range"
    assert KEYS.health("main") == "v2x/rsu-7/health/main"
    assert KEYS.alerts == "v2x/rsu-7/alerts"
    assert KEYS.pairs == "v2x/rsu-7/pairs"
    assert KEYS.liveliness("main") == "v2x/@headway/main"


def test_the_prefix_may_have_several_chunks() -> None:
    keys = Keys("city/v2x", "s")
    assert keys.parse(keys.bsm("a")) == Address("bsm", ("a",))


@pytest.mark.parametrize(
    ("key", "address"),
    [
        (KEYS.bsm("a"), Address("bsm", ("a",))),
        (KEYS.alert("bias", "a"), Address("alert", ("bias", "a"))),
        (KEYS.pair_state("a"), Address("pair", ("a",))),
        (KEYS.rejected("duplicate"), Address("rejected", ("duplicate",))),
        (KEYS.health("main"), Address("health", ("main",))),
    ],
)
def test_parse_takes_apart_what_was_built(key: str, address: Address) -> None:
    assert KEYS.parse(key) == address


@pytest.mark.parametrize(
    "key",
    [
        "",
        "bsm/a",
        "v2x/rsu-7",
        "v2x/rsu-7/bsm",
        "v2x/rsu-7/bsm/",
        "v2x/rsu-7/bsm//a",
        "v2x/rsu-7/bsm/a/b",
        "v2x/rsu-7/bsm/*",
        "v2x/rsu-7/bsm/@a",
        "v2x/rsu-7/bsm/a ",
        "v2x/rsu-8/bsm/a",
        "x/v2x/rsu-7/bsm/a",
        "v2x/rsu-7/pair/a/speed",
        "v2x/rsu-7/alert/bias",
        "v2x/rsu-7/alerts",
    ],
)
def test_parse_knows_no_other_key(key: str) -> None:
    assert KEYS.parse(key) is None


@pytest.mark.parametrize("chunk", ["", "a/b", "a*", "$a", "@a", "a b", "ä", "a\n", "x" * 65])
def test_a_foreign_chunk_cannot_enter_a_key(chunk: str) -> None:
    assert not is_id(chunk)
    with pytest.raises(ValueError, match="identifier"):
        KEYS.bsm(chunk)
    with pytest.raises(ValueError, match="identifier"):
        Keys("v2x", chunk)
    assert is_id(sanitise_id(chunk))


def test_a_prefix_of_other_chunks_is_refused() -> None:
    for prefix in ("", "/v2x", "v2x/", "v2x//a", "v2x/@a"):
        with pytest.raises(ValueError, match="prefix"):
            Keys(prefix, "s")


def test_sanitising_keeps_what_is_right() -> None:
    assert sanitise_id("veh-1_a.b~c") == "veh-1_a.b~c"
    assert sanitise_id("Dev 7/2") == "Dev_7_2"


def test_gateways_and_wildcards() -> None:
    assert is_gateway("gw-1")
    assert not is_gateway("veh-gw-1")
    assert has_wildcard("v2x/**")
    assert has_wildcard("v2x/a$*b")
    assert not has_wildcard(KEYS.bsm("a"))
