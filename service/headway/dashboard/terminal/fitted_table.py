"""A table that leaves out columns where it does not fit, so that no cell is cut."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

Cell = str | Text

_GAP = 2
"""Between two columns."""
_UNLIMITED = 10_000


@dataclass(slots=True)
class FittedTable:
    """Rows without as many of the columns `droppable`, in their order, as the width asks for."""

    columns: Sequence[str]
    droppable: Sequence[str]
    wrapping: Sequence[str] = ()
    """Columns whose cells may take several lines."""
    caption: str | None = None
    note: bool = False
    """Whether a line below names the columns that are left out."""
    rows: list[tuple[tuple[Cell, ...], str]] = field(default_factory=list)

    def add_row(self, *cells: Cell, style: str = "") -> None:
        """Add a row with a cell for each column."""
        self.rows.append((cells, style))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render what fits."""
        widths = dict(self._widths(console, options))
        dropped = []
        for name in self.droppable:
            if sum(widths.values()) + _GAP * (len(widths) - 1) <= options.max_width:
                break
            del widths[name]
            dropped.append(name)
        table = Table(
            box=None, pad_edge=False, padding=(0, _GAP, 0, 0), header_style="bright_black",
            caption=self.caption, caption_justify="left",
        )  # fmt: skip
        for name, width in widths.items():
            table.add_column(name, no_wrap=name not in self.wrapping, min_width=width)
        for cells, style in self.rows:
            named = zip(self.columns, cells, strict=True)
            table.add_row(*(cell for name, cell in named if name in widths), style=style)
        yield table
        if dropped and self.note:
            yield Text(f"not shown, for want of room: {', '.join(dropped[::-1])}", "dim")

    def _widths(self, console: Console, options: ConsoleOptions) -> Iterator[tuple[str, int]]:
        """Yield for each column the width in which none of its cells is cut."""
        wide = options.update_width(_UNLIMITED)
        for i, name in enumerate(self.columns):
            cells = [Measurement.get(console, wide, cell) for cell in (name, *(cells[i] for cells, _ in self.rows))]
            yield name, max(one.minimum if name in self.wrapping else one.maximum for one in cells)
