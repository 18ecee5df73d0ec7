"""Compile the C++ peers with whatever compiler there is, and keep what came out."""

import ctypes
import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

SOURCES = Path(__file__).parent
# A failing sqrt need not set errno, nor a division trap: no code here asks, and loops vectorise.
FLAGS = "-O3 -march=native -std=c++17 -shared -fPIC -fno-math-errno -fno-trapping-math"
ABSENT = "no C++ compiler: none of $CXX, g++ and clang++ is on the PATH"


class CompileError(RuntimeError):
    """There is a compiler, but it cannot compile a peer."""


def compiler() -> list[str] | None:
    """The command of a C++ compiler ($CXX, g++ or clang++), or None."""
    for command in (shlex.split(os.environ.get("CXX", "")), ["g++"], ["clang++"]):
        if command and shutil.which(command[0]):
            return command
    return None


def compiler_version() -> str:
    """The compiler's first line about itself, or why there is none."""
    command = compiler()
    if command is None:
        return "no C++ compiler"
    answer = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False)
    return (answer.stdout or answer.stderr).strip().split("\n")[0]


def load(source: str, macros: Mapping[str, int]) -> ctypes.CDLL:
    """The shared library made from `source`, with OpenMP if it can be had.

    It is compiled afresh when a source, a macro, the compiler or the processor's name changes.

    Raises:
        CompileError: the compiler cannot compile it.
    """
    command = compiler()
    assert command is not None, ABSENT
    folder = _folder()
    # `-march=native` code must not be loaded on another machine that shares the folder
    parts = [source.encode()]
    parts += [path.read_bytes() for path in sorted(SOURCES.glob("*.[ch]pp"))]
    flags = [*FLAGS.split(), *(f"-D{name}={value}" for name, value in macros.items())]
    parts += [" ".join(flags).encode(), compiler_version().encode(), _processor().encode()]
    key = hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]
    library = folder / f"{Path(source).stem}-{key}.so"
    if not library.exists():
        build([*command, *flags], SOURCES / source, library)
    return ctypes.CDLL(str(library))


def build(call: list[str], source: Path, target: Path) -> None:
    """Compile `source` with the command `call`, with OpenMP if it can be had.

    Raises:
        CompileError: the compiler cannot compile it.
    """
    # renamed when done, so that another process never loads half a library
    staging = target.with_suffix(f".{os.getpid()}")
    for openmp in (["-fopenmp"], []):
        answer = subprocess.run(
            [*call, *openmp, str(source), "-o", str(staging)],
            capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        if answer.returncode == 0:
            staging.replace(target)
            return
    raise CompileError(f"{call[0]} cannot compile {source.name}: {_first_line(answer.stderr)}")


def _folder() -> Path:
    """Where libraries are kept: the user's cache, or a temporary folder if that is closed."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "taichi_foam" / "peers"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="taichi_foam_peers_"))


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return "".join(line for line in lines if line.startswith(("model name", "flags")))


def _first_line(text: str) -> str:
    """The first line that speaks of an error, or the first of all."""
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["no message"]
    return next((line for line in lines if "error" in line.lower()), lines[0])
