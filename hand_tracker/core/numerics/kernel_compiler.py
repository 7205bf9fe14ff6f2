"""Compiler of kernels: those that only other kernels call are compiled as parts of these.

Numba makes of each function machine code and an entry from Python, and optimises what it calls anew
with it. Parts are only translated; the kernel that Python calls is optimised and made machine code
once, with all its parts: in 60 % of the time, on a tenth of the disk, and faster, as functions of
which nobody else knows are inlined.
"""

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher


class KernelLibrary(JITCodeLibrary):
    """Code of a kernel and of all its parts."""

    _linking_libraries: list[Any]

    def add_linking_library(self, library: Any) -> None:
        """Link code that this one calls, and the code that a part calls."""
        super().add_linking_library(library)
        if isinstance(library, PartLibrary):
            self._linking_libraries.extend(library._linking_libraries)
        # Each behind its callers: what nothing calls yet is left out as it is linked.
        self._linking_libraries = list(dict.fromkeys(self._linking_libraries[::-1]))[::-1]

    def _optimize_final_module(self) -> None:
        in_parts = {name for library in self._linking_libraries
                    if isinstance(library, PartLibrary) for name in library.functions}
        for function in self._final_module.functions:
            if function.name in in_parts:
                function.linkage = 'internal'
        super()._optimize_final_module()


class PartLibrary(KernelLibrary):
    """Code of a part, which is optimised and made machine code with that of its callers."""

    @property
    def functions(self) -> list[str]:
        """Names of its functions, without those that they call."""
        return [function.name for function in self._final_module.functions
                if not function.is_declaration]

    def finalize(self) -> None:
        """Note that the code is complete."""
        self._finalized = True


class KernelCompiler(Compiler):
    """Numba's compiler; what it compiles while it compiles another kernel is a part.

    Attributes
    ----------
    depth : int
        Kernels being compiled, each of which calls the next.
    finished : int
        Kernels and parts compiled so far.
    """

    depth = finished = 0

    def compile_extra(self, function: Any) -> Any:
        """Compile a function, under the lock of numba's compiler."""
        state, is_part = self.state, KernelCompiler.depth > 0
        library = PartLibrary if is_part else KernelLibrary
        state.library = library(state.targetctx.codegen(), function.__qualname__)
        state.library.enable_object_caching()
        if is_part:
            state.flags.no_cpython_wrapper = state.flags.no_compile = True
        KernelCompiler.depth += 1
        try:
            compiled = super().compile_extra(function)
        finally:
            KernelCompiler.depth -= 1
        KernelCompiler.finished += 1
        if is_part:
            # A name for callers, as an entry would be.
            compiled = compiled._replace(entry_point=object())
            state.targetctx.insert_user_function(
                compiled.entry_point, compiled.fndesc, [compiled.library])
        return compiled


class KernelDispatcher(CPUDispatcher):
    """Numba's dispatcher of a kernel; a part becomes a kernel when Python calls it.

    Attributes
    ----------
    is_whole : bool
        Whether it is a kernel for its callers, too.
    """

    is_whole = False

    def compile(self, signature: Any) -> Any:
        """Compile for arguments of these types where that is not done; return the entry."""
        with global_compiler_lock:
            types, depth = tuple(getattr(signature, 'args', signature)), KernelCompiler.depth
            if not depth and types in self.overloads and is_part(
                    self.overloads[types]):
                del self.overloads[types]
                self._cache_misses[signature] -= 1  # counted as it was a part
            if self.is_whole:
                KernelCompiler.depth = 0
            try:
                return super().compile(signature)
            finally:
                KernelCompiler.depth = depth

    def add_overload(self, compiled: Any) -> None:
        """Add a compiled kernel; a part has no entry that Python may find."""
        if is_part(compiled):
            self.overloads[tuple(compiled.signature.args)] = compiled
        else:
            super().add_overload(compiled)


def is_part(compiled: Any) -> bool:
    """Return whether what numba has compiled is a part of kernels only."""
    return isinstance(compiled.library, PartLibrary)
