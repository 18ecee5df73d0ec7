"""Taichi, as the package imports it: `from taichi_foam.backend import ti`.

It is Taichi itself, with less ado about source code. What it does with that, for error messages for
the most part, takes a third of the time that a process needs until it computes.
"""

from __future__ import annotations

import ast
import inspect
import linecache
import sys
import textwrap
from functools import cache
from types import SimpleNamespace
from typing import Any

import taichi as ti
from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

__all__ = ["ti"]


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Whether a function is decorated in a class; by its frame, not by how the line is written."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals


_taichis_sourcelines = kernel_impl.getsourcelines


@cache
def _getsourcelines(function: Any) -> tuple[list[str], int]:
    """The lines of a function, and the number of the first; Taichi looks through all modules."""
    code = inspect.unwrap(function).__code__
    lines = linecache.getlines(code.co_filename)[code.co_firstlineno - 1 :]
    if not lines:  # typed in, or of a notebook's cell
        return _taichis_sourcelines(function)
    return inspect.getblock(lines), code.co_firstlineno


def _getsourcefile(function: Any) -> str:
    return inspect.unwrap(function).__code__.co_filename


def _position(self: ASTTransformerContext, node: ast.AST) -> str:
    """Where a statement stands, for messages; Taichi adds its text, whether there is any or not."""
    line = node.lineno + self.lineno_offset  # type: ignore[attr-defined]
    assert self.func is not None
    return f'File "{self.file}", line {line}, in {self.func.func.__name__}:\n'


kernel_impl._inside_class = _inside_class
kernel_impl.getsourcelines = _getsourcelines
kernel_impl.getsourcefile = _getsourcefile
kernel_impl.textwrap = SimpleNamespace(fill=cache(textwrap.fill), dedent=cache(textwrap.dedent))
ASTTransformerContext.get_pos_info = _position
