"""All rows: of cloth and nets (rows.py), of soft bodies (soft_rows.py), and of what skeletons and curves carry
(carried_rows.py)."""

from tools.stress import carried_rows, rows, soft_rows

ROWS: list[rows.Row] = [*rows.ROWS, *soft_rows.ROWS, *carried_rows.ROWS]
