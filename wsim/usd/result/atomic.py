"""Files that are there whole or not at all: written under a new name in the same folder, then renamed.

The new name ends in random letters and is only ever created, so that no link and no other file under it is written through
(POSIX open(2), O_EXCL). What was at the final name before stays until the new file is whole; a link there is replaced, not
followed.
"""

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PART = "wsim-part"


@contextmanager
def draft_file(path, ending: str | None = None, named: str | None = None) -> Iterator[Path]:
    """A free name in the folder of `path`; what is written to it is removed when the block ends, unless it was renamed.

    ending    of that name, for writers that go by it; None: that of `path`
    named     after this path (of the same folder), whose `leftover_drafts` it then belongs to; None: after `path`
    """
    path = Path(os.fspath(path))
    ending = path.suffix if ending is None else ending
    name = path.name if named is None else os.path.basename(named)
    temporary = path.with_name(f".{name}.{secrets.token_hex(4)}.{PART}{ending}")
    try:
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def replace_file_atomically(path, ending: str | None = None, named: str | None = None) -> Iterator[Path]:
    """A file as `draft_file` has it; what is written to it becomes `path` if the block ends well."""
    with draft_file(path, ending, named) as temporary:
        yield temporary
        os.replace(temporary, path)


def leftover_drafts(path) -> list[Path]:
    """Drafts of `path` that a killed process left. Only who alone may write `path` may remove it."""
    path = Path(os.fspath(path))
    name = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.{PART}(\.\w+)?\Z")
    return [path.with_name(entry.name) for entry in os.scandir(path.parent)
            if name.match(entry.name) and entry.is_file(follow_symlinks=False)]


def replace_bytes(path, data: bytes) -> None:
    """Writes a file. Raises OSError where it cannot be; an old file then stays."""
    with replace_file_atomically(path) as temporary, open(temporary, "xb") as file:
        file.write(data)


def replace_text(path, text: str) -> None:
    """Replaces a file by a text in UTF-8, as `replace_bytes` does."""
    replace_bytes(path, text.encode("utf-8"))
