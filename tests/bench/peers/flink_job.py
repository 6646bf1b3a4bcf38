"""The job in PyFlink: lines of a socket, keyed by vehicle, the filter in keyed state.

Arguments: the port of the source, the address of the reports.
"""

import json
import os
import sys
import uuid

import job
from pyflink.common import Configuration, Types
from pyflink.datastream import DataStream, KeyedProcessFunction, RuntimeContext, StreamExecutionEnvironment
from pyflink.datastream.state import ValueStateDescriptor

port, reports = sys.argv[1:]


class Judge(KeyedProcessFunction):
    """The filter of each vehicle."""

    def open(self, runtime_context: RuntimeContext) -> None:
        self._state = runtime_context.get_state(ValueStateDescriptor("filter", Types.PICKLED_BYTE_ARRAY()))
        self._report = job.Report(reports, uuid.uuid4().hex)

    def process_element(self, line: str, _context: KeyedProcessFunction.Context):
        message = job.parse(line)
        after, is_alarm = job.step(self._state.value(), message)
        self._state.update(after)
        self._report.add(message, is_alarm=is_alarm)
        return ()


config = Configuration()
config.set_string("python.executable", sys.executable)
config.set_string("python.client.executable", sys.executable)
config.set_string("python.fn-execution.bundle.time", "10")
config.set_string("parallelism.default", os.environ.get("PEER_PARALLELISM", "1"))
environment = StreamExecutionEnvironment.get_execution_environment(config)
environment.add_python_file(job.__file__)
lines = DataStream(environment._j_stream_execution_environment.socketTextStream("127.0.0.1", int(port)))
lines.map(lambda line: line, Types.STRING()).key_by(lambda line: json.loads(line)[1], Types.STRING()).process(Judge())
environment.execute("peer")
