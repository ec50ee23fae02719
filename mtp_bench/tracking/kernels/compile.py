"""Numba kernels that are compiled at their first call and kept in a cache of the user.

    @kernel
    def twice(x: float) -> float: ...

    @kernel("f8(f8[::1], i8)")
    def total(x: Floats, n: int) -> float: ...  # may call twice

    @kernel(inline=True)
    def part(x: Floats) -> float: ...  # long, and called in one place: compiled as a part of its caller

    @kernel(vectorize=True)
    def scale(x: Floats, by: float) -> None: ...  # long simple loops: worth the search for vector instructions

Importing a module of kernels does not import numba. A kernel is a module-level function that numba's nopython mode
understands; it may use constants of its module and call other kernels, of any module, by their plain names.
``total(x, 3)`` compiles it and what it calls, or loads them from the cache. ``total.python(x, 3)`` runs the same
source, callees included, in plain Python; so does ``total(x, 3)`` under NUMBA_DISABLE_JIT. ``total.compiled()`` is
numba's own dispatcher, for hot loops. With a signature nothing else is accepted; without one every new combination of
types, layouts and writability is compiled anew, silently: bring arrays to one type before the call. To numba a literal
0 or True is a type of its own: hand callees variables like ``0 * n``, or they are compiled twice.

The cache is a folder below NUMBA_CACHE_DIR or the user's cache folder, named by a digest of what a kernel's code
depends on: numba itself looks only at the file of a kernel, not at those of its callees. Where the folder cannot be
written, as in a read-only container, every process compiles for itself.
"""

from __future__ import annotations

import gc
import hashlib
import importlib
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property
from pathlib import Path
from types import FunctionType
from typing import Any, Generic, ParamSpec, TypeVar, final, overload

P = ParamSpec("P")
R = TypeVar("R")
_MAKERS = {"array", "copy", "empty", "full", "ones", "zeros"}  # a maker that is not named here fails to compile
_lock = threading.RLock()


@final
class Kernel(Generic[P, R]):
    """A function that runs compiled; see the module's text."""

    def __init__(
        self, function: Callable[P, R], signature: str | None = None, inline: bool = False, vectorize: bool = False
    ) -> None:
        assert isinstance(function, FunctionType)  # a kernel is written with def
        self.function = function
        self.signature = signature
        self.inline = inline
        self.vectorize = vectorize
        self.__doc__ = function.__doc__
        self._run: Any = None

    def __call__(self, *args: Any, **kwargs: Any) -> R:
        """What the function returns, from compiled code."""
        # Arguments are not P's: to a type checker an element of an array may be an array.
        result: R = (self._run or self.compiled())(*args, **kwargs)
        return result

    @cached_property
    def python(self) -> Callable[P, R]:
        """The function and all kernels that it calls, in plain Python."""
        return self._bound({name: callee.python for name, callee in self._callees().items()})

    def compiled(self) -> Any:
        """Numba's dispatcher, compiled already if the kernel has a signature; the Python twin if numba is off."""
        if self._run is None:
            with _lock, _no_garbage_collection():
                numba: Any = importlib.import_module("numba")
                self._run = self.python if numba.config.DISABLE_JIT else self._compile(numba, callee=False)
        return self._run

    @property
    def folder(self) -> Path:
        """Where the compiled kernel is kept, once it is."""
        return cache_folder() / f"kernels-{self._digest(importlib.import_module('numba').__version__)}"

    @cached_property
    def _as_callee(self) -> Any:
        return self._compile(importlib.import_module("numba"), callee=True)

    def _compile(self, numba: Any, callee: bool) -> Any:
        """Numba's dispatcher; that of a callee has no wrapper for calls from Python, which is long to compile.

        Nor is a callee kept in the cache, which costs a tenth of the time: its caller is.
        """
        folder = None if callee else _writable(self.folder)
        known = folder is not None and any(folder.glob(f"*/*.{self.function.__name__}-*.nbi"))
        if not callee and not known:
            _tell(folder is not None)
        signature = [] if self.signature is None else [self.signature]
        options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": callee}
        if callee and self.inline:
            options["inline"] = "always"
        if callee and not self._makes_arrays():
            options["_nrt"] = False  # no counting of references: arrays belong to the caller
        jit = numba.njit(*signature, cache=folder is not None, **options)
        with _settings(numba.config, str(folder or numba.config.CACHE_DIR), self.vectorize):
            if known and signature:
                with suppress(numba.TypingError):  # not in the cache after all: the file has another time stamp
                    return jit(self._bound({}))
            return jit(self._bound({name: kernel._as_callee for name, kernel in self._callees().items()}))

    def _makes_arrays(self) -> bool:
        """Whether it or what it calls makes or returns arrays, by the names in its code and its annotations."""
        plain = re.fullmatch(r"(tuple|int|float|bool|None|[\[\], ])+", str(self.function.__annotations__["return"]))
        # What an inlined kernel returns stays in its caller.
        own = not (plain or self.inline) or not _MAKERS.isdisjoint(self.function.__code__.co_names)
        return own or any(callee._makes_arrays() for callee in self._callees().values())

    def _callees(self) -> dict[str, Kernel[Any, Any]]:
        """Kernels that the function calls, by the names it calls them."""
        return {name: value for name, value in self._globals().items() if isinstance(value, Kernel)}

    def _globals(self) -> dict[str, Any]:
        known = self.function.__globals__
        return {name: known[name] for name in self.function.__code__.co_names if name in known}

    def _bound(self, names: dict[str, Any]) -> FunctionType:
        """The function with other meanings of some of its global names."""
        old = self.function
        new = FunctionType(old.__code__, {**old.__globals__, **names}, old.__name__, old.__defaults__)
        new.__module__, new.__qualname__, new.__doc__ = old.__module__, old.__qualname__, old.__doc__
        return new

    def _digest(self, numba_version: str) -> str:
        """Of the sources and constants of the kernel and of all it calls, of Python, numba and the processor."""
        processor = importlib.import_module("llvmlite.binding").get_host_cpu_name()
        digest = hashlib.sha256(repr((sys.version, numba_version, processor, *sorted(self._parts()))).encode())
        return digest.hexdigest()[:16]

    def _parts(self) -> set[str]:
        constants = {n: v for n, v in self._globals().items() if isinstance(v, (bool, int, float, str, tuple))}
        records = [v for v in self._globals().values() if isinstance(v, type) and issubclass(v, tuple)]
        files = {_source(sys.modules[record.__module__].__file__ or "") for record in records}
        files |= {_source(self.function.__code__.co_filename), _source(__file__)}
        parts = {*files, repr((self.signature, self.inline, self.vectorize, sorted(constants.items())))}
        return parts.union(*(callee._parts() for callee in self._callees().values()))


@overload
def kernel(
    given: str | None = None, /, inline: bool = False, vectorize: bool = False
) -> Callable[[Callable[P, R]], Kernel[P, R]]: ...
@overload
def kernel(given: Callable[P, R], /) -> Kernel[P, R]: ...
def kernel(given: Any = None, /, inline: bool = False, vectorize: bool = False) -> Any:
    """A function as a `Kernel`; a decorator, with or without numba's signature."""
    if given is None or isinstance(given, str):
        return lambda function: Kernel(function, given, inline, vectorize)
    return Kernel(given)


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Numba makes millions of objects that stay, over which the collector would go again and again."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextmanager
def _settings(config: Any, folder: str, vectorize: bool) -> Iterator[None]:
    """Numba's cache in ``folder`` and its first level of optimisation: as fast kernels, sooner."""
    importlib.import_module("numba.core.registry").cpu_target.target_context.codegen()  # made once, for all of numba
    ours = {"CACHE_DIR": folder, "OPT": type(config.OPT)("1"), "LOOP_VECTORIZE": int(vectorize), "SLP_VECTORIZE": 0}
    before = {name: getattr(config, name) for name in ours}
    _set(config, ours)
    try:
        yield
    finally:
        _set(config, before)


def _set(config: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        setattr(config, name, value)


@cache
def _source(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def cache_folder() -> Path:
    """The folder of all compiled kernels: the one that NUMBA_CACHE_DIR names, else the user's cache folder."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        return Path(given).absolute()  # numba, and whoever shows it to an agent, may work in another folder
    from platformdirs import user_cache_path

    return user_cache_path("mtp_bench", appauthor=False)


@cache
def _writable(folder: Path) -> Path | None:
    """The folder, made if need be; None if it cannot be written."""
    probe = folder / f"probe-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError:
        return None
    return folder


@cache  # once
def _tell(stored: bool) -> None:
    """Say that the first call takes a while."""
    where = "once per machine" if stored else "in every process (set NUMBA_CACHE_DIR to a folder that can be written)"
    print(f"mtp_bench: compiling the tracking kernels, {where}: about 20 s", file=sys.stderr, flush=True)
