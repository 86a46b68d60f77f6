"""All rows: of cloth and nets (rows.py), and of soft bodies (soft_rows.py)."""

from tools.stress import rows, soft_rows

ROWS: list[rows.Row] = [*rows.ROWS, *soft_rows.ROWS]
