"""The file of a fleet."""

from pathlib import Path

import pytest

from headway.errors import UserError
from headway.fleet.config import bus_options, read_config, revision_of

GOOD = """
state_dir = "/srv/headway"
cpus = 0.5

[settings]
connect = ["tcp/10.0.0.1:7447"]
prefix = "v2x/city"
lease_s = 1

[sites.crossing-1]
[sites.crossing-2]
alarm_budget_per_hour = 2.0
"""


@pytest.fixture
def written(tmp_path: Path):
    def write(text: str) -> Path:
        file = tmp_path / "fleet.toml"
        file.write_text(text, encoding="utf-8")
        return file

    return write


def test_a_file_names_sites_and_their_settings(written) -> None:
    config = read_config(written(GOOD), {"crossing-2", "crossing-3"})
    assert sorted(config.sites) == ["crossing-1", "crossing-2", "crossing-3"]
    assert config.sites["crossing-2"] == {"alarm_budget_per_hour": 2.0}
    bus = bus_options(config)
    assert (bus.prefix, bus.connect) == ("v2x/city", ("tcp/10.0.0.1:7447",))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('state_dir = "/srv/headway"', "", "state_dir"),
        ("/srv/headway", "srv", "starts with /"),
        ("cpus", "cups", "cups"),
        ("[sites.crossing-1]", "[sites.'a b']", "sites"),
        ("[sites.crossing-1]\n[sites.crossing-2]\nalarm_budget_per_hour = 2.0", "", "no site"),
        ("alarm_budget_per_hour", "alarm_budget", "did you mean alarm_budget_per_hour"),
        ("2.0", "-1.0", "site crossing-2: alarm_budget_per_hour"),
        ("alarm_budget_per_hour = 2.0", "epoch = 4", "the fleet gives it"),
        ('connect = ["tcp/10.0.0.1:7447"]', "", "needs an endpoint in connect"),
        ("[settings]", "[settings", "not the TOML"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(written, old: str, new: str, says: str) -> None:
    with pytest.raises(UserError, match=says.replace("[", r"\[")) as refused:
        read_config(written(GOOD.replace(old, new)))
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="No such file"):
        read_config(tmp_path / "none.toml")


def test_a_revision_differs_with_settings_and_release_and_not_with_the_epoch(written) -> None:
    config = read_config(written(GOOD))
    same = revision_of(config, "crossing-1", "1")
    assert revision_of(read_config(written(GOOD.replace("2.0", "3.0"))), "crossing-1", "1") == same
    assert revision_of(config, "crossing-1", "2") != same
    assert revision_of(read_config(written(GOOD.replace("lease_s = 1", "lease_s = 2"))), "crossing-1", "1") != same
