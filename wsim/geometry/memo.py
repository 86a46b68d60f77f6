"""Results of costly functions of arrays, kept by content. NumPy only.

A scene is checked when it is loaded, saved and simulated, and its model cuts and welds the same meshes again: with a
million points that is seconds each time. The latest results are kept under a digest of the arguments (BLAKE2,
Aumasson and others 2013: a gigabyte a second, and two different meshes never share one), not under the identity of the
arrays, which may be changed in place.
"""

import functools
import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import TypeVar

import numpy as np

KEPT = 6                # results of each function: those of a few meshes, tens of megabytes for a million points
Function = TypeVar("Function", bound=Callable)


def digest_of_arguments(*arguments) -> bytes:
    """Digest of arrays (their type, shape and values) and of anything else by its repr."""
    found = hashlib.blake2b(digest_size=32)
    for argument in arguments:
        if isinstance(argument, np.ndarray):
            found.update(f"{argument.dtype.str}{argument.shape};".encode())
            found.update(np.ascontiguousarray(argument).data.cast("B") if argument.size else b"")
        else:
            found.update(f"{argument!r};".encode())
    return found.digest()


def _copy_of_result(result):
    """The caller may change what it gets."""
    if isinstance(result, np.ndarray):
        return result.copy()
    return type(result)(map(_copy_of_result, result)) if isinstance(result, (tuple, list)) else result


def keep_latest_results(function: Function, most: int = KEPT) -> Function:
    """Keeps the latest results, so many, of a function whose positional arguments are arrays and short values."""
    kept: OrderedDict[bytes, object] = OrderedDict()
    lock = threading.Lock()

    @functools.wraps(function)
    def memoized_call(*arguments):
        key = digest_of_arguments(*arguments)
        with lock:
            if key in kept:
                kept.move_to_end(key)
                return _copy_of_result(kept[key])
        result = function(*arguments)
        with lock:
            kept[key] = _copy_of_result(result)
            while len(kept) > most:
                kept.popitem(last=False)
        return result

    return memoized_call  # type: ignore[return-value]
