"""Which machine gets a site."""

from headway.fleet.placement import Node, Placement, choose_node

NODES = [Node("a", 4.0), Node("b", 2.0), Node("c", 1.0)]


def placed(*nodes: str) -> list[Placement]:
    return [Placement(site=f"s{k}", epoch=1, node=node, revision="r", host=f"h{k}") for k, node in enumerate(nodes)]


def test_the_node_with_most_processors_left_is_chosen() -> None:
    assert choose_node(NODES, [], 1.0) == "a"
    assert choose_node(NODES, placed("a", "a", "a"), 1.0) == "b"
    assert choose_node(NODES, placed("a", "a"), 1.0) == "a"


def test_a_node_without_room_is_never_chosen() -> None:
    assert choose_node(NODES, placed("a", "a"), 2.0) == "b"
    assert choose_node(NODES, placed("a", "a", "b"), 2.0) is None
    assert choose_node(NODES, [], 4.5) is None
    assert choose_node([], [], 1.0) is None


def test_an_avoided_node_is_the_last_choice_and_an_excluded_one_none() -> None:
    assert choose_node(NODES, [], 1.0, avoided={"a": 1.0}) == "b"
    assert choose_node(NODES, [], 2.0, avoided={"a": 2.0, "b": 1.0}) == "b"
    assert choose_node(NODES, [], 2.0, avoided={"a": 1.0, "b": 2.0}) == "a"
    assert choose_node(NODES, [], 3.0, avoided={"a": 1.0}) == "a"
    assert choose_node(NODES, [], 3.0, excluded={"a"}) is None
