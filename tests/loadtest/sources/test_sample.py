import numpy as np
from loadtest.sources.spmd_sample import HOST_FILE, TARGETS_FILE, write_sample

from headway_loadtest.sources import parse_sources
from headway_loadtest.sources.synthetic import PLATOON, drives


def scenes(folder):
    return list(parse_sources([str(folder)], seconds=0, seed=0))


def test_the_same_seed_writes_the_same_files(tmp_path):
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        folder = tmp_path / name
        folder.mkdir()
        write_sample(folder, pairs=2, seconds=3.0, seed=seed)
        texts.append((folder / HOST_FILE).read_text() + (folder / TARGETS_FILE).read_text())
    assert texts[0] == texts[1] != texts[2]


def test_what_is_read_back_is_what_was_driven(tmp_path):
    write_sample(tmp_path, pairs=2, seconds=30.0, seed=1)
    for number, (host, leader) in enumerate(scenes(tmp_path)):
        _, true_leader, true_host = drives(3, 30.0, 1, first=number * PLATOON, window_ms=(0, 0))
        assert np.allclose(host.speed_mps, true_host.speed_mps, atol=1e-3)
        assert np.allclose(leader.speed_mps, true_leader.speed_mps, atol=0.02)
        assert np.abs(host.lat - true_host.lat).max() * 111_000 < 0.1
        gap_m = true_leader.x_m - true_host.x_m - true_leader.length_m
        assert np.allclose(leader.x_m - host.x_m, gap_m, atol=0.02)


def test_one_trip_in_four_loses_its_leader_for_a_while(tmp_path):
    write_sample(tmp_path, pairs=4, seconds=20.0)
    found = scenes(tmp_path)
    assert [len(scene) for scene in found] == [2, 2, 2, 3]
    assert found[3][0].ahead is not None
    assert (found[3][0].ahead.which < 0).sum() == 30
