"""Compiled kernels on disk: numba's cache, in one folder that may be full or read-only.

Of a loaded kernel no more is prepared than calling it takes: numba would also parse its bitcode and
import all that compiling needs, a fifth of a node's start. So no symbols but those of numba's core
are there for it: kernels that hash, say, would lack theirs.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary, ll
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime.nrt import rtsys

from .kernel_compiler import is_part

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


class LoadedLibrary(JITCodeLibrary):
    """Machine code of a kernel from the disk; its bitcode is parsed for a kernel that calls it."""

    _bitcode: bytes
    _shared_module: Any

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, _, (object_code, bitcode) = state
        library = cls(codegen, name)
        library.enable_object_caching()
        library._set_compiled_object(object_code)
        library._bitcode = bitcode
        library._finalize_final_module()
        return library

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = ll.parse_bitcode(self._bitcode)
            self._bitcode = b''
        return self._shared_module

    def get_pointer_to_function(self, name: str) -> int:
        """Return the address of a function of the machine code, which has it."""
        # Numba's looks for it among the names that it reads from the bitcode.
        return self._codegen._engine.get_function_address(name)


class KernelStorage(FunctionCache._impl_class):
    """Numba's storage of a cached kernel, in `KernelFolder` alone."""

    _locator_classes = (KernelFolder,)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return a kernel from its pickled parts."""
        codegen = target_context.codegen()
        usual = codegen._library_class
        with global_compiler_lock:
            codegen._library_class = LoadedLibrary
            try:
                return super().rebuild(target_context, payload)
            finally:
                codegen._library_class = usual


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
            rtsys.initialize(target)  # for kernels that allocate
            compiled = self._load_overload(types, target)
            # An index may name a file of other types, where its own could no longer be written.
            # Those of a callback are a whole signature.
            wanted = tuple(getattr(types, 'args', types))
            if compiled is not None and compiled.signature.args == wanted:
                return compiled
        return None

    def save_overload(self, types: Any, compiled: Any) -> None:
        """Keep a compiled kernel where that is possible; parts are in that of their callers."""
        if is_part(compiled):
            return
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
