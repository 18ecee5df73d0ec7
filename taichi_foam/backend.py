"""Taichi, as the package imports it: `from taichi_foam.backend import ti`.

It is Taichi itself with faster handling of source code. Taichi's own handling, mostly for error
messages, takes a third of the time that a process needs before it computes.

TAICHI_FOAM_BACKEND=quadrants uses Quadrants instead, a maintained fork of Taichi, as an experiment:
install `quadrants`. Numbers may differ in their last digits, and the kernels that come with the
package work with Taichi only. All use of undocumented features of either is in this module, with
notes on how the two differ.
"""

from __future__ import annotations

import ast
import gc
import inspect
import linecache
import os
import sys
import textwrap
from collections import defaultdict
from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

__all__ = ["compiling", "has_fields_elsewhere", "is_present", "keeps_ticache", "ti", "version"]

NAME = os.environ.get("TAICHI_FOAM_BACKEND") or "taichi"
"""The backend in use: taichi or quadrants."""

if NAME not in ("taichi", "quadrants"):
    raise ImportError(
        f"TAICHI_FOAM_BACKEND = {NAME!r}: choose taichi (the default) or quadrants",
        name=__name__,
    )

if TYPE_CHECKING or NAME == "taichi":
    import taichi as ti
else:
    os.environ.setdefault("ENABLE_QUADRANTS_HEADER_PRINT", "0")
    try:
        import quadrants as ti  # type: ignore[import-not-found]
    except ModuleNotFoundError as error:
        raise ImportError(
            f"TAICHI_FOAM_BACKEND=quadrants: needs {error.name}, which is not installed. "
            "Fix: python -m pip install quadrants",
            name=__name__,
        ) from None


def version() -> str:
    """Version of the backend: 1.7.4 for Taichi, quadrants-1.3.3 for Quadrants."""
    number = ".".join(map(str, ti.__version__))
    return number if NAME == "taichi" else f"{NAME}-{number}"


def keeps_ticache() -> bool:
    """Whether kernels are cached on disk in the files that `engine.kernel_cache` can repair.

    Quadrants uses other files, in a subfolder, which it manages itself.
    """
    return NAME == "taichi"


def is_present(arch: str) -> bool:
    """Whether the GPU `arch` is available here; `ti.init` alone would fall back to the CPU."""
    core = import_module(f"{NAME}._lib").core
    return bool(getattr(core, f"with_{arch}")())


def compiling() -> Any:
    """Compiler settings for all later kernels, to be modified in place; requires `ti.init`."""
    program = import_module(f"{NAME}.lang.impl").get_runtime().prog
    assert program is not None
    return program.config()


def has_fields_elsewhere(trees: int) -> bool:
    """Whether the device holds fields or arrays beyond `trees` trees of fields.

    The default tree is empty unless a program places fields in it.
    """
    made = sum(root.ptr.get_num_ch() > 0 for root in ti.FieldsBuilder._finalized_roots())
    begun = import_module(f"{NAME}.lang.impl").get_runtime().unfinalized_fields_builder
    arrays = (thing for thing in gc.get_objects() if isinstance(thing, ti.Ndarray))
    return (
        made != trees
        or not all(builder.empty for builder in begun)
        or next(arrays, None) is not None
    )


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Whether a function is decorated in a class; found from its frame, not from the source."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals


@cache
def _last_lines(file: str) -> dict[int, int]:
    """The last line of each function in a file, by its first, which is that of its decorators."""
    found: dict[int, int] = {}
    try:
        tree = ast.parse("".join(linecache.getlines(file)))
    except SyntaxError:  # changed since it was imported, or a notebook cell with a magic command
        return found
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            first = min(each.lineno for each in (node, *node.decorator_list))
            found[first] = node.end_lineno or first
    return found


@cache
def _getsourcelines(function: Any) -> tuple[list[str], int]:
    """The lines of a function, and the number of the first; Taichi's own searches all modules."""
    code = inspect.unwrap(function).__code__
    first = code.co_firstlineno
    last = _last_lines(code.co_filename).get(first)
    if last is None:  # typed interactively, or changed
        return _taichis_sourcelines(function)
    return linecache.getlines(code.co_filename)[first - 1 : last], first


def _getsourcefile(function: Any) -> str:
    return inspect.unwrap(function).__code__.co_filename


def _position(self: Any, node: ast.AST) -> str:
    """Position of a statement, for messages; unlike Taichi's, without the source text."""
    line = node.lineno + self.lineno_offset  # type: ignore[attr-defined]
    assert self.func is not None
    return f'File "{self.file}", line {line}, in {self.func.func.__name__}:\n'


def _no_traceback(stacklevel: int = 1) -> str:
    """Where a field was made, for messages; Taichi's own formats the stack for every field."""
    return ""


_spare_trees: defaultdict[str, list[Any]] = defaultdict(list)


def _parse(source: str) -> Any:
    """The syntax tree of a function; Taichi parses a function at each of its calls.

    A tree in use is not given out again: a function that calls itself needs several.
    """
    spare = _spare_trees[source]
    if spare:
        tree = spare.pop()
        for node in tree.attributes:  # the vector whose method was called
            vars(node).pop("caller", None)
        return tree
    tree: Any = ast.parse(source)
    tree.source = source
    tree.attributes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    return tree


def _transform_tree(tree: Any, context: Any) -> Any:
    """Translate a syntax tree, and keep it for the next call of the function.

    A translation writes values into the tree, which the next one replaces or `_parse` removes. It
    takes the arguments out of a kernel's tree, which is of no more use.
    """
    collects = gc.isenabled()
    gc.disable()  # a translation makes many objects, and all of them are in use until its end
    try:
        result = _taichis_transform(tree, context)
    finally:
        if collects:
            gc.enable()
    if not context.is_kernel:
        _spare_trees[tree.source].append(tree)
    return result


if NAME == "taichi":
    # Quadrants reads the source once and keeps positions: it does not need these
    from taichi.lang import impl, kernel_impl, matrix, snode
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

    _taichis_sourcelines = kernel_impl.getsourcelines
    kernel_impl._inside_class = _inside_class
    kernel_impl.getsourcelines = _getsourcelines
    kernel_impl.getsourcefile = _getsourcefile
    kernel_impl.textwrap = SimpleNamespace(fill=cache(textwrap.fill), dedent=cache(textwrap.dedent))
    ASTTransformerContext.get_pos_info = _position
    _taichis_transform = kernel_impl.transform_tree
    kernel_impl.transform_tree = _transform_tree
    kernel_impl.ast = SimpleNamespace(parse=_parse)
    impl.get_traceback = matrix.get_traceback = snode.get_traceback = _no_traceback
