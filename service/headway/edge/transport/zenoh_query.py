"""A query of zenoh that is answered from a thread of its own, so that a slow asker holds up nothing."""

import zenoh

from headway.edge.worker import Worker


class ZenohQuery:
    """One query under `key`; `answers` sends its replies."""

    def __init__(self, query: zenoh.Query, key: str, answers: Worker) -> None:
        self._query = query
        self._answers = answers
        self.key = key
        self.payload = b"" if query.payload is None else query.payload.to_bytes()
        self.parameters = {
            name: value for name, _, value in (p.partition("=") for p in str(query.parameters).split(";")) if name
        }

    def answer(self, payload: bytes, encoding: str) -> None:
        """Answer once and end the query."""
        self._answers.put(lambda: self._reply(payload, encoding))

    def refuse(self, reason: str) -> None:
        """Answer with an error and end the query."""
        self._answers.put(lambda: self._reply_error(reason))

    def _reply(self, payload: bytes, encoding: str) -> None:
        self._query.reply(self.key, payload, encoding=encoding)
        self._query.drop()

    def _reply_error(self, reason: str) -> None:
        self._query.reply_err(reason.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)
        self._query.drop()
