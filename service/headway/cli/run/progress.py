"""How far a run has come, and the one line that ends a run whose input is at fault."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from headway.errors import UserError
from headway_loadtest import run as runs
from headway_loadtest.inject.faults import SpecError
from headway_loadtest.sources import SourceError
from headway_loadtest.traffic.session import SessionError


@contextmanager
def in_one_line() -> Iterator[None]:
    """Turn what the load generator cannot use into an error of the user."""
    try:
        yield
    except (SourceError, SpecError, SessionError) as error:
        raise UserError(str(error)) from None


@contextmanager
def progress_bar(what: str, total_s: float, console: Console) -> Iterator[Callable[[runs.Progress], None]]:
    """Show a bar while a run lasts; call what is yielded with each progress."""
    columns = (TextColumn(what), BarColumn(), TextColumn("{task.fields[counts]}"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=total_s, counts="")

        def show(progress: runs.Progress) -> None:
            counts = f"{progress.sent:,} messages sent, {progress.alerts} alerts received"
            bar.update(task, completed=progress.t_s, counts=counts)

        yield show
