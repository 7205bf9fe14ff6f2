"""Compiled kernels on disk: numba's cache, in one folder that may be full or read-only."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba.core.caching import FunctionCache

GivenFolder: Any = FunctionCache._impl_class._locator_classes[0]


class KernelFolder(GivenFolder):
    """Cache locator for numba: always the given folder, writable or not.

    Numba itself would then keep kernels beside their source, where changes of other files do not
    make new ones.
    """

    @classmethod
    def from_function(cls, function: Any, file: str) -> Any:
        """Return the place of a function's kernels."""
        return cls(function, file)


class KernelStorage(FunctionCache._impl_class):
    """Numba's storage of a cached kernel, in `KernelFolder` alone."""

    _locator_classes = (KernelFolder,)


class KernelCache(FunctionCache):
    """Cache of one kernel; if it can be neither loaded nor saved, this process compiles its own.

    Parameters
    ----------
    kernel : callable
        In plain Python.
    report : callable
        Takes the error where a compiled kernel cannot be kept.
    """

    _impl_class = KernelStorage

    def __init__(self, kernel: Callable[..., Any], report: Callable[[OSError], None]) -> None:
        super().__init__(kernel)
        self._report = report

    def load_overload(self, types: Any, target: Any) -> Any:
        """Return the kernel compiled for arguments of these types, None where it is not there."""
        # What unpickles a file that was cut, by a power failure, say, may raise anything.
        with suppress(Exception):
            compiled = super().load_overload(types, target)
            # An index may name a file of other types, where its own could no longer be written.
            if compiled is not None and compiled.signature.args == tuple(types):
                return compiled
        return None

    def save_overload(self, types: Any, compiled: Any) -> None:
        """Keep a compiled kernel where that is possible."""
        try:
            try:
                super().save_overload(types, compiled)
            except OSError:
                raise
            except Exception:  # the index was cut
                self.flush()
                super().save_overload(types, compiled)
        except OSError as error:
            self._report(error)
