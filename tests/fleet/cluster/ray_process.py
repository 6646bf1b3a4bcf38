"""A Ray cluster on this machine: a head without processors, and a node for each name on standard input.

It prints the address, then the process id of the raylet of each node. The cluster ends with standard input.
"""

import json
import sys
import time

from ray.cluster_utils import Cluster

SYSTEM = {
    "health_check_initial_delay_ms": 2_000,
    "health_check_period_ms": 1_000,
    "health_check_timeout_ms": 2_000,
    "health_check_failure_threshold": 5,
}
CPUS = 8
"""Declared, not real."""
NODE = {"object_store_memory": 80 << 20, "include_dashboard": False}


def main() -> None:
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "_system_config": SYSTEM, **NODE})
    print(json.dumps({"address": cluster.address}), flush=True)
    for line in sys.stdin:
        node = cluster.add_node(wait=False, num_cpus=CPUS, node_name=line.strip(), **NODE)
        [raylet] = node.all_processes["raylet"]
        print(json.dumps({"node": line.strip(), "pid": raylet.process.pid}), flush=True)
    time.sleep(1.0)
    cluster.shutdown()


if __name__ == "__main__":
    main()
