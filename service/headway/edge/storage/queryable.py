"""Queries for what the journal's file holds, answered in a thread of their own."""

import sqlite3
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Final

from pydantic import ValidationError

from headway.edge.storage.journal_format import Reason, reason_of
from headway.edge.transport.ports import Query
from headway.edge.worker import Worker
from headway.errors import first_problem

_QUERIES_MAX: Final = 64
"""Most queries that wait."""
_CLOSE_S: Final = 1.0


class JournalQueryable(ABC):
    """Answers or refuses queries, whatever the loop and the writer do; `on_damage` is called for a damaged file."""

    trouble: ClassVar[str]
    """How a refusal begins when the file fails."""

    def __init__(self, name: str, on_damage: Callable[[], None] = lambda: None) -> None:
        self._on_damage = on_damage
        self._worker = Worker(name, _QUERIES_MAX, sqlite3.Error)

    def ask(self, query: Query) -> None:
        """Queue a query."""
        self._worker.put(lambda: self._answer(query))

    def close(self) -> None:
        """Answer the queries that wait."""
        self._worker.close(_CLOSE_S)

    @abstractmethod
    def _found(self, query: Query) -> tuple[bytes, str]:
        """Return an answer and its encoding; raises `ValidationError` or `sqlite3.Error`."""

    def _answer(self, query: Query) -> None:
        try:
            answer, encoding = self._found(query)
        except ValidationError as error:
            query.refuse(first_problem(error))
        except sqlite3.Error as error:
            if reason_of(error) is Reason.CORRUPT:
                self._on_damage()
            query.refuse(f"{self.trouble} ({reason_of(error)}): {error}")
        else:
            query.answer(answer, encoding)
