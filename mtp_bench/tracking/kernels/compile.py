"""Kernels: functions that Numba compiles at their first call and caches.

    @kernel("f8(f8[::1], i8)")
    def total(x: Floats, n: int) -> float: ...  # may call twice

    @part
    def twice(x: float) -> float: ...

A kernel is called from Python; its signature says which types it takes. A part is
compiled with every kernel that calls it, and remains a plain function in Python:
``total.function(x, 3)`` runs the same source, parts included, without Numba. So does
``total(x, 3)`` under NUMBA_DISABLE_JIT. Every kernel is in ``KERNELS`` once its module
is imported.

`cache` says where compiled kernels are kept, in a cache of the user. Processes that
need the same kernel wait for the one that compiles it.
"""

import gc
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from types import FunctionType
from typing import Any, Generic, TypeVar, cast, final

import numba
from numba.extending import register_jitable

from ...core import long_work, say_once
from . import cache

R = TypeVar("R")
F = TypeVar("F", bound=Callable[..., Any])
_config: Any = numba.config
_lock = threading.RLock()
# no C function calls a kernel
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
# CPU seconds of the slow kernels and of each other one, about 50 for all:
# `benchmarks/compile.py`
_SLOW_COMPILE_S = {"joint_k_best": 22.0, "k_means": 5.0}
_COMPILE_S = 1.5
_UNCACHED = (
    "compiling the kernels of trackers and samplers: about 50 CPU seconds in every "
    "process, since the cache cannot be written; set MTP_BENCH_CACHE to another folder"
)
# how Numba's RuntimeError begins where it finds no folder to write to
_NO_CACHE = "cannot cache function"


@final
class Kernel(Generic[R]):
    """A function that runs compiled."""

    def __init__(self, function: Callable[..., R], signature: str) -> None:
        self.function = cast(FunctionType, function)
        self.signature = signature
        self.__doc__ = function.__doc__
        self._compiled: Callable[..., R] | None = None

    def __call__(self, *args: Any) -> R:
        """Call the compiled function."""
        return (self._compiled or self.compile())(*args)

    def compile(self) -> Callable[..., R]:
        """Return Numba's dispatcher, from the cache if it is there.

        It is the plain function if Numba is switched off.
        """
        with _lock:
            if self._compiled is None:
                self._compiled = self.function if _config.DISABLE_JIT else self._load()
        return self._compiled

    @cached_property
    def folder(self) -> Path:
        """Folder of the compiled kernel in the cache."""
        return cache.folder_of(self.function, self.signature)

    @property
    def is_cached(self) -> bool:
        """True if nothing has to be compiled."""
        return bool(_config.DISABLE_JIT) or cache.is_sound(
            self.folder, self.function.__code__.co_filename
        )

    def can_be_cached(self) -> bool:
        """Check that its folder can be written to.

        Otherwise the user is told that every process compiles it.
        """
        try:
            with cache.locked(self.folder):
                return True
        except OSError:
            say_once(_UNCACHED)
            return False

    @property
    def seconds(self) -> float:
        """CPU seconds that compiling it takes, roughly."""
        return _SLOW_COMPILE_S.get(self.function.__name__, _COMPILE_S)

    def _load(self) -> Callable[..., R]:
        try:
            if self.is_cached:
                return self._jit(self.folder)
            text = (
                f"compiling kernel {self.function.__name__} of trackers and samplers, "
                "once per installation"
            )
            with long_work(text, self.seconds), cache.locked(self.folder):
                # no other process has compiled it meanwhile
                if not self.is_cached and cache.clear(self.folder):
                    say_once(
                        f"a compiled kernel in {self.folder} is damaged and compiled "
                        "again"
                    )
                compiled = self._jit(self.folder)
                cache.seal(self.folder)
                return compiled
        except (OSError, RuntimeError) as error:
            if isinstance(error, RuntimeError) and not str(error).startswith(_NO_CACHE):
                raise
            say_once(_UNCACHED)
            return self._jit(None)

    def _jit(self, folder: Path | None) -> Callable[..., R]:
        with _cache_in(folder), _no_garbage_collection():
            decorate: Any = numba.njit(
                self.signature, cache=folder is not None, nogil=True, **_OPTIONS
            )
            return cast(Callable[..., R], decorate(self.function))


KERNELS: list[Kernel[Any]] = []


def kernel(signature: str) -> Callable[[Callable[..., R]], Kernel[R]]:
    """Decorate a kernel with Numba's signature, such as ``"f8(f8[::1], i8)"``."""

    def register(function: Callable[..., R]) -> Kernel[R]:
        KERNELS.append(Kernel(function, signature))
        return KERNELS[-1]

    return register


def part(function: F) -> F:
    """Decorate a function that kernels call."""
    return register_jitable(**_OPTIONS)(function)


def inlined(function: F) -> F:
    """Decorate a function whose code is written into its callers.

    That saves counting references to each array that it takes, which in a short
    function costs more than its work.
    """
    return cast(F, numba.njit(inline="always", error_model="numpy")(function))


@contextmanager
def _cache_in(folder: Path | None) -> Iterator[None]:
    """Let Numba use this cache while it compiles."""
    previous_folder = _config.CACHE_DIR
    if folder is not None:
        _config.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        _config.CACHE_DIR = previous_folder


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Stop the garbage collector while Numba makes millions of objects.

    It would visit them again and again.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
