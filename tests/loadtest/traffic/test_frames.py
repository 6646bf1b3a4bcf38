import numpy as np
import pytest

from headway_loadtest.inject.faults import Kind, Spec
from headway_loadtest.sources.drive import Ahead, Drive, SourceError
from headway_loadtest.sources.synthetic import SyntheticDrives
from headway_loadtest.traffic.frames import SCENES_AHEAD, SceneFrames, span_s


def drive(vehicle, seconds=3.0, ahead=None):
    t_s = np.arange(0.0, seconds, 0.1)
    ones = np.ones(len(t_s))
    return Drive(
        vehicle=vehicle,
        t_s=t_s,
        x_m=t_s,
        speed_mps=t_s,
        lat=42.0 * ones,
        lon=-83.0 * ones,
        heading_deg=90.0 * ones,
        ahead=ahead,
    )


def played(scenes, **options):
    frames = SceneFrames(scenes, **options)
    return list(frames), frames


def messages(frames):
    ids = {}
    for frame in frames:
        ids.update({vehicle.row: vehicle.id for vehicle in frame.entering})
        for i in range(len(frame)):
            yield ids[int(frame.row[i])], int(frame.t_us[i]), int(frame.msg_cnt[i]), float(frame.speed_mps[i])


def test_every_sample_is_a_message_once_and_in_order():
    frames, _ = played([(drive("a"), drive("b")), (drive("c", 1.0),)])
    found = list(messages(frames))
    times = [t_us for _, t_us, _, _ in found]
    assert times == sorted(times)
    for vehicle, count in (("a", 30), ("b", 30), ("c", 10)):
        speeds = [speed for sender, _, _, speed in found if sender == vehicle]
        assert np.allclose(speeds, np.arange(count) / 10)


def test_vehicles_of_a_scene_share_a_phase_and_scenes_do_not():
    frames, _ = played([(drive("a"), drive("b")), (drive("c"),)], seed=3)
    first = {}
    for vehicle, t_us, _, _ in messages(frames):
        first.setdefault(vehicle, t_us)
    assert first["a"] == first["b"] != first["c"]
    assert all(t_us < 100_000 and t_us % 1000 == 0 for t_us in first.values())


def test_msg_cnt_counts_and_wraps():
    frames, _ = played([(drive("a", 20.0),)])
    assert [msg_cnt for _, _, msg_cnt, _ in messages(frames)] == [i % 128 for i in range(200)]


def test_msg_cnt_does_not_count_what_is_never_sent():
    frames, source = played([(drive("a", 200.0),)], inject=Spec(kinds=(Kind.MISS,)))
    counts = [msg_cnt for _, _, msg_cnt, _ in messages(frames)]
    assert source.labels
    assert len(counts) < 2000
    assert counts == [i % 128 for i in range(len(counts))]


def test_no_more_than_so_many_are_under_way():
    frames, _ = played(((drive(f"v{i}", 1.0),) for i in range(7)), concurrent=3)
    starts = {}
    for vehicle, t_us, _, _ in messages(frames):
        starts.setdefault(vehicle, t_us)
    assert len(starts) == 7
    assert sorted(t_us // 1_000_000 for t_us in starts.values()) == [0, 0, 0, 1, 1, 1, 2]


def test_scenes_are_read_only_when_there_is_room():
    read = []

    def scenes():
        for i in range(1000):
            read.append(i)
            yield (drive(f"v{i}", 1.0),)

    frames = iter(SceneFrames(scenes(), concurrent=3))
    next(frames)
    assert len(read) <= 3 + SCENES_AHEAD + 2


def test_a_source_named_twice_is_one_line():
    with pytest.raises(SourceError, match="a drives twice at once: is a source named twice"):
        played([(drive("a"),), (drive("a"),)])


def test_seconds_cut_the_replay_short():
    frames, _ = played([(drive("a", 30.0),)], seconds=1.0)
    assert max(t_us for _, t_us, _, _ in messages(frames)) < 1_000_000


def test_what_is_cut_off_has_no_label():
    _, source = played(SyntheticDrives(4, 60.0, 1), inject=Spec(kinds=(Kind.SHORT,), p=0.02), seconds=10.0)
    assert source.labels
    assert max(label.start_us for label in source.labels) < 10_000_000


def test_labels_are_in_replay_time():
    frames, source = played(SyntheticDrives(4, 60.0, 1), inject=Spec(kinds=(Kind.SHORT,), p=0.01, c=9.0))
    times = {}
    for vehicle, t_us, _, _ in messages(frames):
        times.setdefault(vehicle, set()).add(t_us)
    assert source.labels
    assert all(label.start_us in times[label.vehicle] for label in source.labels)


def test_iterating_again_is_the_same_again():
    frames, source = played(SyntheticDrives(4, 10.0, 1), inject=Spec(p=0.02))
    once, labels = list(messages(frames)), list(source.labels)
    assert list(messages(source)) == once
    assert source.labels == labels


def test_declared_leaders_come_with_their_messages():
    which = np.array([0, 0, -1, 1, 1])
    range_m = np.array([20.0, 21.0, np.nan, 30.0, 31.0])
    ahead = Ahead(("x", "y"), which, range_m, np.where(which < 0, np.nan, 0.5))
    frames, _ = played([(drive("a", 0.5, ahead), drive("b", 0.5))])
    found = [record for frame in frames for record in frame.leader or ()]
    assert [record for record in found if record] == [
        ("x", 20.0, 0.5),
        ("x", 21.0, 0.5),
        ("y", 30.0, 0.5),
        ("y", 31.0, 0.5),
    ]
    assert len(found) == 10


def test_nothing_declared_nothing_carried():
    frames, _ = played([(drive("a"),)])
    assert all(frame.leader is None for frame in frames)


def test_span_is_the_time_of_the_last_message():
    _, source = played([(drive("a", 30.0),)])
    assert span_s(source) == pytest.approx(29.9, abs=0.11)
    assert span_s(SceneFrames([])) == 0.0
