import msgpack
import numpy as np
import pytest

from headway_loadtest.traffic.encode import GATEWAY, Encoder
from headway_loadtest.traffic.frames import Frame, Vehicle
from headway_loadtest.traffic.schedule import Schedule
from headway_schemas import Keys
from headway_schemas.bsm import from_record
from headway_schemas.keys import is_gateway

KEYS = Keys("v2x", "crossing")
SCHEDULE = Schedule(start_ns=0, start_unix_us=1_700_000_000_000_000)


def frame(*t_ms, entering=(), leader=None):
    n = len(t_ms)
    return Frame(
        entering=tuple(entering),
        t_us=np.array(t_ms) * 1000,
        row=np.arange(n),
        msg_cnt=np.arange(n),
        lat=42.0 + np.arange(n),
        lon=-83.0 - np.arange(n),
        speed_mps=10.0 + np.arange(n),
        heading_deg=90.0 + np.arange(n),
        leader=leader,
    )


VEHICLES = [Vehicle(0, "a", 4.5), Vehicle(1, "b", None), Vehicle(2, "c", 5.5)]


def batches(*frames, **options):
    return list(Encoder(KEYS, **options).batches(frames, SCHEDULE))


def test_a_payload_is_a_record_of_the_wire_contract_on_the_senders_key():
    (batch,) = batches(frame(7, 7, 7, entering=VEHICLES))
    first = from_record(msgpack.unpackb(batch.payloads[0]))
    assert (first.id, first.msg_cnt, first.t_us) == ("a", 0, 1_700_000_000_007_000)
    assert (first.lat, first.lon, first.speed_mps, first.heading_deg) == (42.0, -83.0, 10.0, 90.0)
    assert (first.length_m, first.leader) == (4.5, None)
    assert [str(key) for key in batch.keys] == [KEYS.bsm(name) for name in "abc"]
    assert from_record(msgpack.unpackb(batch.payloads[1])).length_m is None


def test_a_declared_leader_is_carried():
    (batch,) = batches(frame(7, 7, 7, entering=VEHICLES, leader=[("z", 20.0, -0.5), None, None]))
    first, second, _ = (from_record(msgpack.unpackb(payload)) for payload in batch.payloads)
    assert first.leader is not None
    assert (first.leader.id, first.leader.range_m, first.leader.range_rate_mps) == ("z", 20.0, -0.5)
    assert second.leader is None


def test_what_is_due_together_is_one_batch():
    found = batches(frame(7, 7, 9, entering=VEHICLES))
    assert [(batch.due_ns, len(batch.payloads)) for batch in found] == [(7_000_000, 2), (9_000_000, 1)]
    assert [batch.last_event_us - SCHEDULE.start_unix_us for batch in found] == [7000, 9000]


@pytest.mark.parametrize(("bundle", "sizes"), [(2, [2, 1]), (3, [3]), (25, [3])])
def test_bundles_hold_so_many_at_most_and_come_by_a_gateway(bundle, sizes):
    (batch,) = batches(frame(7, 7, 7, entering=VEHICLES), bundle=bundle)
    unpacked = [msgpack.unpackb(payload) for payload in batch.payloads]
    assert [len(records) for records in unpacked] == batch.records == sizes
    assert [from_record(record).id for records in unpacked for record in records] == ["a", "b", "c"]
    assert {str(key) for key in batch.keys} == {KEYS.bsm(GATEWAY)}
    assert is_gateway(GATEWAY)
    assert len(batch.rows) == 3


def test_a_row_changes_hands():
    encoder = Encoder(KEYS)
    frames = [frame(7, entering=VEHICLES), frame(9, entering=[Vehicle(0, "a-1", 3.5)])]
    first, second = encoder.batches(frames, SCHEDULE)
    assert encoder.ids == ["a-1", "b", "c"]
    assert encoder.ids_ever == {"a", "a-1", "b", "c"}
    assert str(first.keys[0]) == KEYS.bsm("a")
    renamed = from_record(msgpack.unpackb(second.payloads[0]))
    assert (str(second.keys[0]), renamed.id, renamed.length_m) == (KEYS.bsm("a-1"), "a-1", 3.5)


def test_an_empty_frame_is_no_batch():
    assert batches(frame(entering=VEHICLES)) == []
