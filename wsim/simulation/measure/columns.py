"""Tables of text: rows of cells, one below the other."""

from collections.abc import Sequence


def text_columns(rows: Sequence[Sequence[str]], sides: str, widths: Sequence[int | None] = (), gap: str = "  ") -> list[str]:
    """A line for each row, its cells in columns.

    sides    "<" or ">" for each column: where its cells stand      widths   of the first columns; None, or none given: that of
    the longest cell; a longer cell than its column pushes the rest      gap      between columns
    """
    wide = [max((len(row[k]) for row in rows), default=0) if k >= len(widths) or widths[k] is None else widths[k]
            for k in range(len(sides))]
    return [gap.join(f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, wide, strict=True)) for row in rows]
