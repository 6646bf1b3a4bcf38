"""A Kafka cluster of one broker: librdkafka's own mock, whose broker goes `down` and `up` by a word on standard input.

What it stored stays, as after a restart. Prints the address of the broker, then a line for each word obeyed.
"""

import ctypes
import sys
from pathlib import Path

import confluent_kafka

PRODUCER = 0

folder = Path(confluent_kafka.__file__).parents[1] / "confluent_kafka.libs"
kafka = ctypes.CDLL(str(next(folder.glob("librdkafka*"))))
kafka.rd_kafka_conf_new.restype = ctypes.c_void_p
kafka.rd_kafka_new.restype = ctypes.c_void_p
kafka.rd_kafka_new.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t]
kafka.rd_kafka_mock_cluster_new.restype = ctypes.c_void_p
kafka.rd_kafka_mock_cluster_new.argtypes = [ctypes.c_void_p, ctypes.c_int]
kafka.rd_kafka_mock_cluster_bootstraps.restype = ctypes.c_char_p
kafka.rd_kafka_mock_cluster_bootstraps.argtypes = [ctypes.c_void_p]
words = {"down": kafka.rd_kafka_mock_broker_set_down, "up": kafka.rd_kafka_mock_broker_set_up}
for call in words.values():
    call.argtypes = [ctypes.c_void_p, ctypes.c_int32]

client = kafka.rd_kafka_new(PRODUCER, kafka.rd_kafka_conf_new(), ctypes.create_string_buffer(512), 512)
cluster = kafka.rd_kafka_mock_cluster_new(client, 1)
print(kafka.rd_kafka_mock_cluster_bootstraps(cluster).decode(), flush=True)
for line in sys.stdin:
    words[line.strip()](cluster, 1)
    print("obeyed", flush=True)
