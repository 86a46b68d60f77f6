"""The folder of a sweep: what it is of, and its rows.

    sweep.json      what tells it from others: scene, draws, settings, version
    rows.jsonl      a line a run as it ends, flushed to the disk: what `--resume` goes on from; a line that was cut is left out
    runs.csv        the table, in the order of runs, written anew beside it and renamed: valid at any time
    runs.parquet    the same, where pyarrow is installed, at the end
    results/        a result layer a run
    sweep.lock      while a sweep writes there

Columns are those of the draws, then of the runs; CIRCUMSTANCES are the last, and alone differ between two sweeps of one kind.
Numbers are written so that they read back to the bit.
"""

import csv
import io
import json
import os
from importlib.util import find_spec
from pathlib import Path
from time import monotonic
from typing import Any

from wsim.scene import Problem, SceneError
from wsim.usd.result.atomic import replace_file_atomically, replace_text
from wsim.usd.result.lock import OutputLock

Row = dict[str, Any]
CIRCUMSTANCES = ("result", "seconds", "worker", "worlds", "tries")
LAST = ("warnings", "seed", "version", "scene_hash", "state", *CIRCUMSTANCES)
LOCK = "sweep.lock"
OFTEN = 2.0            # [s] between two writings of the table


class SweepFolder:
    """Folder of a sweep, which one process at a time writes. Raises SceneError where it holds another sweep, or this one and it
    is not resumed; BlockingIOError where a sweep writes there now."""

    def __init__(self, path: str, identity: dict, names: list[str], *, resume: bool = False):
        """names: of the draws' targets, in order."""
        self.path, self.names, self.rows = Path(path), names, dict[int, Row]()
        self.written = 0.0
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise SceneError(Problem(path, "is a file, or lies in one; give a folder")) from None
        self.lock = OutputLock(str(self.path / LOCK), path)
        try:
            self._open(path, identity, resume)
        except BaseException:
            self.lock.release()
            raise

    def _open(self, path: str, identity: dict, resume: bool) -> None:
        known = self._known_identity()
        if known is None:
            if any(entry.name != LOCK for entry in self.path.iterdir()):
                raise SceneError(Problem(path, "holds other files and no sweep; give a folder that is empty or not there"))
            replace_text(self.path / "sweep.json", json.dumps(identity, indent=1))
        elif known != identity:
            raise SceneError(Problem(path, f"holds another sweep ({describe_sweep_difference(known, identity)}); give another "
                                           f"folder"))
        elif not resume and (self.path / "rows.jsonl").exists() and (self.path / "rows.jsonl").stat().st_size:
            raise SceneError(Problem(path, "holds this sweep already; go on with it by --resume, or give another folder"))
        self._read_earlier_rows(identity["draws"])
        self.journal = open(self.path / "rows.jsonl", "a", encoding="utf-8")           # noqa: SIM115  (closed by `close`)

    def _known_identity(self) -> dict | None:
        try:
            return json.loads((self.path / "sweep.json").read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise SceneError(Problem(str(self.path / "sweep.json"), f"cannot be read ({error}); give another folder")) from None

    def _read_earlier_rows(self, draws: list[dict]) -> None:
        """Rows that an earlier sweep has of these draws, whose results are there; failures are tried again. The journal is left
        with whole lines."""
        file = self.path / "rows.jsonl"
        if not file.exists():
            return
        good = []
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True):
            try:
                row = json.loads(line)
                if line.endswith("\n") and self._row_still_holds(row, draws):
                    good.append(row)
            except (ValueError, KeyError, TypeError):
                pass
        self.rows = {row["run"]: row for row in good}
        replace_text(file, "".join(json.dumps(row) + "\n" for row in self.rows.values()))

    def _row_still_holds(self, row: Row, draws: list[dict]) -> bool:
        """True if a row is of a run of these draws that has ended well, and the result that it names is there."""
        number = row["run"]
        if row["status"] != "done" or type(number) is not int or not 0 <= number < len(draws):
            return False
        same = all(row.get(name) == value for name, value in draws[number].items())
        return same and (not row.get("result") or os.path.isfile(self.path / row["result"]))

    def add(self, rows: list[Row]) -> None:
        """Rows of runs that have ended: on the disk when this returns."""
        if not rows:
            return
        self.journal.write("".join(json.dumps(row) + "\n" for row in rows))
        self.journal.flush()
        os.fsync(self.journal.fileno())
        self.rows.update({row["run"]: row for row in rows})
        if monotonic() - self.written > OFTEN:
            self.write()

    def write(self) -> None:
        """Writes the table."""
        replace_text(self.path / "runs.csv", rows_as_csv(list(self.ordered()), self.columns()))
        self.written = monotonic()

    def ordered(self) -> list[Row]:
        return [self.rows[number] for number in sorted(self.rows)]

    def columns(self) -> list[str]:
        """Names of the columns: run, draws, status, errors as runs have them, and the last ones."""
        found = dict.fromkeys(["run", *self.names, "status", "why", "frames"])
        errors = dict.fromkeys(name for row in self.ordered() for name in row)
        return [*found, *(name for name in errors if name not in found and name not in LAST), *LAST]

    def close(self) -> None:
        """Writes the table as it is now, and lets others write."""
        try:
            self.journal.close()
            self.write()
            if find_spec("pyarrow") is not None:
                write_parquet(self.ordered(), self.columns(), self.path / "runs.parquet")
        finally:
            self.lock.release()


def rows_as_csv(rows: list[Row], columns: list[str]) -> str:
    """Rows as CSV."""
    out = io.StringIO()
    write = csv.writer(out, lineterminator="\n")
    write.writerow(columns)
    write.writerows([[csv_cell(row.get(name)) for name in columns] for row in rows])
    return out.getvalue()


def csv_cell(value) -> str:
    """A value as text that reads back to the bit; a vector as numbers with blanks between."""
    if value is None:
        return ""
    if isinstance(value, (list, tuple)):
        return " ".join(csv_cell(v) for v in value)
    return repr(value) if isinstance(value, float) else str(value)


def write_parquet(rows: list[Row], columns: list[str], path: Path) -> None:
    """Rows as Parquet; vectors and what is not of one type are text."""
    import pyarrow
    from pyarrow import parquet as files
    table = {}
    for name in columns:
        values = [row.get(name) for row in rows]
        kinds = {type(v) for v in values if v is not None}
        plain = kinds <= {int, float} or kinds <= {str}
        table[name] = values if plain else [None if v is None else csv_cell(v) for v in values]
    with replace_file_atomically(path) as temporary:
        files.write_table(pyarrow.table(table), str(temporary))


def describe_sweep_difference(known: dict, wanted: dict) -> str:
    """Text about what tells two sweeps apart."""
    names = [name for name in wanted if known.get(name) != wanted[name]]
    short = [f"{name}: {known.get(name)!r:.60} there, {wanted[name]!r:.60} here" for name in names if name != "draws"]
    draws = [f"{len(known.get('draws', []))} draws there, {len(wanted['draws'])} here" if
             len(known.get("draws", [])) != len(wanted["draws"]) else "other draws"] if "draws" in names else []
    return "; ".join(short + draws)
