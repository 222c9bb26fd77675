"""How numba makes and keeps machine code here: functions that compiled ones alone call become part
of them, and what is kept is loaded by itself.

It replaces parts of numba's inside as numba 0.68 has them; the lock holds that version.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from llvmlite import binding as llvm
from numba.core import caching, compiler
from numba.core.codegen import JITCodeLibrary
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime import _nrt_python


class Part(JITCodeLibrary):
    """A function's code for others to link in. It is neither optimised nor translated by itself:
    whoever calls it does both, with the whole before it.
    """

    def finalize(self) -> None:
        """Link what it calls."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> Part:
        """What numba asks to set an environment of a function that it has compiled."""
        return self

    def set_env(self, name: str, environment: object) -> None:
        """Nothing: the environment is set in what the part is linked into."""

    def serialize_using_object_code(self) -> tuple[str, bytes, None, list[str]]:
        """The name and the code to link."""
        self._ensure_finalized()
        return self.name, self._final_module.as_bitcode(), None, []


class Whole(JITCodeLibrary):
    """A function's machine code with all its parts, and the code to link where another compiled
    function calls it.
    """

    _linkable: bytes | None = None

    def _finalize_final_module(self) -> None:
        super()._finalize_final_module()
        # of its parts; as numba keeps them with the code
        for variable in self._final_module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None:
                self._codegen.set_env(variable.name, environment)

    def _get_module_for_linking(self) -> llvm.ModuleRef:
        if self._linkable is not None:
            self._shared_module, self._linkable = llvm.parse_bitcode(self._linkable), None
        return super()._get_module_for_linking()

    def serialize_using_object_code(self) -> tuple[str, bytes, bytes, list[str]]:
        """The name, the code to link, the machine code and the names that it defines."""
        module = self._get_module_for_linking()
        defined = [
            value.name
            for values in (module.functions, module.global_variables)
            for value in values
            if not value.is_declaration
        ]
        return self.name, module.as_bitcode(), self._get_compiled_object(), defined


def _loaded(
    codegen: object, name: str, code: bytes, machine_code: bytes | None, defined: list[str]
) -> Part | Whole:
    """What one of them was kept as, again."""
    if machine_code is None:
        part = Part(codegen, name)
        part._final_module = llvm.parse_bitcode(code)
        part._finalized = True
        return part
    whole = Whole(codegen, name)
    whole.enable_object_caching()
    whole._set_compiled_object(machine_code)
    whole._linkable = code
    whole._finalize_final_module()
    codegen._engine._defined_symbols.update(defined)
    return whole


class PartCompiler(compiler.Compiler):
    """Numba's compiler, for functions that compiled ones alone call."""

    def compile_extra(self, function: Callable) -> compiler.CompileResult:
        """The result, with a :class:`Part` as its code. What it needs of numba's own stays
        numba's.
        """
        codegen = self.state.targetctx.codegen()
        self.state.library = self._new_library(codegen, function.__qualname__)
        return super().compile_extra(function)

    def _new_library(self, codegen: object, name: str) -> Part | Whole:
        return Part(codegen, name)


class WholeCompiler(PartCompiler):
    """Numba's compiler, for functions with a way in: their code is a :class:`Whole`."""

    def _new_library(self, codegen: object, name: str) -> Whole:
        library = Whole(codegen, name)
        library.enable_object_caching()
        return library


class Kept(caching.CompileResultCacheImpl):
    """How compiled functions are written to files and read again."""

    def reduce(self, result: compiler.CompileResult) -> tuple:
        """As numba's, but the environments of functions that are part of this one by the names of
        their modules: to read them imports none.
        """
        *payload, others = super().reduce(result)
        return *payload, [
            (other.env_name, other.globals["__name__"], other.consts) for other in others
        ]

    def rebuild(self, target_context: object, payload: tuple) -> compiler.CompileResult:
        """As numba's, with the code of :func:`_loaded`."""
        code, fndesc, environment, signature, objectmode, lifted, annotation, init, others = payload
        codegen = target_context.codegen()
        library = _loaded(codegen, *code)
        entry = target_context.get_executable(library, fndesc, environment)
        others = [_environment(*other) for other in others]
        for other in others:
            library.codegen.set_env(other.env_name, other)
        return compiler.compile_result(
            target_context=target_context,
            typing_context=target_context.typing_context,
            library=library,
            environment=environment,
            entry_point=entry,
            fndesc=fndesc,
            type_annotation=annotation,
            signature=signature,
            objectmode=objectmode,
            lifted=lifted,
            reload_init=init,
            referenced_envs=others,
        )


def _environment(name: str, module: str, constants: list) -> Environment:
    """The environment of this name: where there is none, one of these ``constants``, which are all
    of it that machine code reads.
    """
    environment = lookup_environment(name)
    if environment is None:
        environment = Environment({"__name__": module})
        environment.consts[:] = constants
        environment.env_name = name
        Environment._memo[name] = environment
    return environment


@cache
def _register_runtime() -> None:
    """Tell LLVM where numba's runtime lies, which kept code calls. What compiled code needs beside,
    numba compiles when it first compiles.
    """
    for name, address in _nrt_python.c_helpers.items():
        llvm.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


class Cache(caching.FunctionCache):
    """Numba's cache, but to load from it does not import all that numba can compile."""

    _impl_class = Kept

    def load_overload(self, signature: object, target_context: object) -> object:
        """What is kept of the function for the ``signature``; None where nothing is."""
        _register_runtime()
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target_context)
