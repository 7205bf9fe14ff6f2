"""Compiler of kernels: those that only other kernels call are compiled as parts of these.

Numba makes of each function machine code and an entry from Python, and optimises what it calls anew
with it. Parts are only translated; the kernel that Python calls is optimised and made machine code
once, with all its parts: in 60 % of the time, on a tenth of the disk, and faster, as functions of
which nobody else knows are inlined.

Numba counts the references to each array. The caller of a kernel holds its arrays until the kernel
returns: in one that returns none they are not counted, by atomic instructions that took up to two
thirds of its time.
"""

from typing import Any

from numba.core import cgutils, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering


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


class KernelLower(Lower):
    """Numba's translation of a function; the arrays given to one that returns none are borrowed."""

    @property
    def _borrows(self) -> bool:
        """Whether all that it gets with a counter are arrays, and it returns nothing with one."""
        others = [kind for kind in _leaves(types.Tuple(self.fndesc.argtypes))
                  if not isinstance(kind, types.Array)]
        return not any(self.context.data_model_manager[kind].contains_nrt_meminfo()
                       for kind in (self.fndesc.restype, *others))

    def extract_function_arguments(self) -> Any:
        """Return the arguments; borrowed arrays are without the counter of their references."""
        self.fnargs: Any = super().extract_function_arguments()
        if self._borrows:
            self.fnargs = tuple(map(self._borrowed, self.fndesc.argtypes, self.fnargs))
        return self.fnargs

    def _borrowed(self, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = self.context.make_array(kind)(self.context, self.builder, value=value)
            array.meminfo = cgutils.get_null_value(array.meminfo.type)
            return array._getvalue()
        for index, part in enumerate(kind if isinstance(kind, types.BaseTuple) else ()):
            borrowed = self._borrowed(part, self.builder.extract_value(value, index))
            value = self.builder.insert_value(value, borrowed, index)
        return value

    def create_cpython_wrapper(self, *arguments: Any, **options: Any) -> None:
        """Make the entry from Python; for borrowed arrays in tuples, dozens, without counters."""
        has_tuple = any(isinstance(kind, types.BaseTuple) for kind in self.fndesc.argtypes)
        self.context.enable_nrt = not (has_tuple and self._borrows)
        try:
            super().create_cpython_wrapper(*arguments, **options)
        finally:
            self.context.enable_nrt = True


def _leaves(kind: Any) -> list[Any]:
    """Return the types in nested tuples of numba's types."""
    if isinstance(kind, types.BaseTuple):
        return [leaf for part in kind for leaf in _leaves(part)]
    return [kind]


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):
    """Numba's pass of that translation."""

    @property
    def lowering_class(self) -> type[Lower]:
        """Return the class that translates."""
        return KernelLower


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

    def define_pipelines(self) -> list[Any]:
        """Return numba's passes, with that of kernels for its own."""
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.passes = [(KernelLowering if each is NativeLowering else each, name)
                               for each, name in pipeline.passes]
        return pipelines

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
