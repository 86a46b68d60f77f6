"""Version of the code that rewrites kernel source. Warp's hash does not cover the rewriting, so binaries need it."""

import hashlib
import inspect
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType

from wsim.model.compiler import core_sharing, header, source, variants
from wsim.model.warp_private import PLAIN

MODULES = (core_sharing, header, source, variants)


def rewriting_version() -> str:
    """Digest of the rewriting modules' text and of any function that replaces one of theirs; "plain" if nothing is
    rewritten."""
    if PLAIN:
        return "plain"
    found = hashlib.blake2b(digest_size=16)
    for module in MODULES:
        found.update(_text_of_module(module))
        for name, value in sorted(vars(module).items()):
            if isinstance(value, FunctionType) and value.__module__ not in {m.__name__ for m in MODULES} | LENT:
                found.update(f"{name} {_source_of_function(value)}".encode())
    return found.hexdigest()


LENT = {"contextlib", "functools"}                  # of which these modules take functions


def _source_of_function(function: FunctionType) -> str:
    try:
        return inspect.getsource(function)
    except (OSError, TypeError):                    # typed at a prompt
        return function.__code__.co_code.hex()


@cache
def _text_of_module(module: ModuleType) -> bytes:
    return Path(str(module.__file__)).read_bytes()
