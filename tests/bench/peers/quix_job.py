"""The job in quixstreams: a topic keyed by vehicle, the filter in its state (RocksDB).

Arguments: the brokers, the topic, a folder for the state, and the address of the reports.
"""

import os
import sys

import job
from quixstreams import Application, State
from quixstreams.models.topics import TopicAdmin, TopicConfig

brokers, topic, folder, reports = sys.argv[1:]
report = job.Report(reports, str(os.getpid()))


def inspect_topics(admin: TopicAdmin, names: list[str], timeout: float = 30.0) -> dict[str, TopicConfig]:
    """Return the topics by their metadata: the mock broker has no request for their configuration."""
    topics, kept = admin.list_topics(timeout), {"retention.ms": "-1", "retention.bytes": "-1"}
    return {name: TopicConfig(len(topics[name].partitions), 1, kept) for name in names}


TopicAdmin.inspect_topics = inspect_topics


def judge(line: bytes, state: State) -> None:
    """Judge one message with the state of its vehicle."""
    message = job.parse(line)
    before = state.get("filter")
    after, is_alarm = job.step(before and tuple(before), message)
    state.set("filter", after)
    report.add(message, is_alarm=is_alarm)


app = Application(
    broker_address=brokers,
    consumer_group="peer",
    auto_offset_reset="earliest",
    consumer_extra_config={"fetch.wait.max.ms": 10},  # the mock broker answers a waiting fetch at its end only
    auto_create_topics=False,
    use_changelog_topics=False,
    state_dir=folder,
    loglevel="WARNING",
)
frame = app.dataframe(app.topic(topic, value_deserializer="bytes", key_deserializer="str"))
frame.update(judge, stateful=True)
app.run()
