"""Every compiled function of the project is compiled alike."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("service", "loadtest", "schemas")


def njit_calls():
    """Each use of numba's njit as (file and line, keyword arguments); a bare decorator has none."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            called = {id(node.func): node for node in ast.walk(tree) if isinstance(node, ast.Call)}
            for node in ast.walk(tree):
                if isinstance(node, ast.Name) and node.id in {"njit", "jit", "vectorize", "guvectorize"}:
                    call = called.get(id(node))
                    keywords = {word.arg: ast.literal_eval(word.value) for word in call.keywords} if call else {}
                    yield pytest.param(keywords, id=f"{path.relative_to(ROOT)}:{node.lineno}")


@pytest.mark.parametrize("keywords", list(njit_calls()))
def test_a_kernel_is_cached_and_divides_as_numpy_does(keywords) -> None:
    """A division by zero in a kernel gives an infinity that the checks for finite values see, never an exception."""
    assert keywords.get("cache") is True
    assert keywords.get("error_model") == "numpy"
