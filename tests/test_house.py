"""Limits of folders, files and functions, one definition of a class in each layer, and the tree of ARCHITECTURE.md."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest
from conftest import ROOT

PYTHON = sorted(
    path
    for top in ("service", "schemas", "loadtest", "tests", "deploy", "docker", "examples")
    for path in (ROOT / top).rglob("*.py")
)
CODE = [path for path in PYTHON if path.relative_to(ROOT).parts[0] in ("service", "schemas", "loadtest")]
ROOTS = ("service/headway", "schemas/headway_schemas", "loadtest/headway_loadtest")

LINES_MAX, FILES_MAX, PARAMETERS_MAX = 400, 14, 10


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_no_file_is_longer_than_one_idea() -> None:
    lengths = {name(path): len(path.read_text(encoding="utf-8").splitlines()) for path in PYTHON}
    assert {path: lines for path, lines in lengths.items() if lines > LINES_MAX} == {}


def test_no_folder_holds_more_files_than_one_sees_at_a_glance() -> None:
    folders: dict[str, int] = defaultdict(int)
    for path in PYTHON:
        folders[name(path.parent)] += 1
    assert {folder: files for folder, files in folders.items() if files > FILES_MAX} == {}


def test_no_function_takes_more_parameters_than_one_can_name() -> None:
    found = {}
    for path in PYTHON:
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                count = len(node.args.posonlyargs) + len(node.args.args) + len(node.args.kwonlyargs)
                if count > PARAMETERS_MAX:
                    found[f"{name(path)}:{node.lineno}"] = count
    assert found == {}


def layer(path: Path) -> str:
    """Return the part of the project in which a name has one meaning."""
    parts = path.relative_to(ROOT).parts[1:]
    return "/".join(parts[:2]) if parts[0] == "headway" and len(parts) > 2 else parts[0]


def test_a_class_has_one_definition_in_each_layer() -> None:
    places = defaultdict(list)
    for path in CODE:
        for node in parsed(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[layer(path), node.name].append(name(path))
    assert {key: paths for key, paths in places.items() if len(paths) > 1} == {}


def test_the_architecture_page_shows_the_tree() -> None:
    page = (ROOT / "docs" / "ARCHITECTURE.md").read_text(encoding="utf-8")
    shown, above = set(), list[str]()
    for line in page.split("```")[1].strip().splitlines():
        indent, folder = (len(line) - len(line.lstrip())) // 4, line.split()[0]
        assert folder.endswith("/"), f"a line of the tree starts with a folder, not {folder}"
        above = [*above[:indent], folder.rstrip("/")]
        shown.add("/".join(above))
    assert shown == {name(path.parent) for path in CODE}


@pytest.mark.parametrize("root", ROOTS)
def test_each_folder_says_what_it_holds(root: str) -> None:
    folders = {path.parent for path in CODE if name(path).startswith(root)}
    silent = [name(f) for f in folders if not ast.get_docstring(parsed(f / "__init__.py"))]
    assert silent == []
