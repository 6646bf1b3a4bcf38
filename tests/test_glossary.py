"""The words of the code are the words of docs/GLOSSARY.md."""

from pathlib import Path

import pytest

from headway.core.estimation.imm.driver_input import driver_dtype
from headway.core.estimation.imm.noise_adaptation import ADAPTED_NOISE
from headway.core.estimation.imm.state import MODES
from headway.core.types.records import READING, VERDICT, Kind

GLOSSARY = (Path(__file__).parents[1] / "docs" / "GLOSSARY.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [*(READING.names or ()), *(VERDICT.names or ())])
def test_every_column_is_in_the_glossary(name: str) -> None:
    assert f"`{name}`" in GLOSSARY


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.NONE])
def test_every_kind_is_in_the_glossary(kind: Kind) -> None:
    assert f"| `{kind.label}` |" in GLOSSARY


@pytest.mark.parametrize("name", ["delay_s", "delay_jitter_s", "alarm_budget_per_hour"])
def test_every_symbol_that_is_a_setting_is_in_the_glossary(name: str) -> None:
    assert f"`{name}`" in GLOSSARY


RINGS = ("input_count", "input_t", "input_u")
ROWS = (MODES, ADAPTED_NOISE, driver_dtype(0.0))


@pytest.mark.parametrize("name", sorted({name for row in ROWS for name in row.names or ()} - {*RINGS}))
def test_every_column_of_the_default_model_is_in_the_glossary(name: str) -> None:
    assert f"`{name}`" in GLOSSARY
