"""The nine drop tests of Shim, Tu & Lim (2000), Int. J. Impact Engng 24, 703-731.

Their scenes come with the package (`scenes/paper`), with the measured figures. This module has what
else the paper says about each.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from taichi_foam import catalogue
from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.scene.reference import Reference


@dataclass(frozen=True)
class PaperTest:
    """One of the nine tests.

    name                name of its scene
    picture             number of the figure that shows the block during the impact
    simulated_duration  impact duration in the paper's own simulation [s]
    """

    name: str
    picture: int | None = None
    simulated_duration: float | None = None

    @property
    def kind(self) -> str:
        """ "rectangular", "cylinder" or "wedge"."""
        return brief(self.name).partition("-")[0]

    @property
    def velocity(self) -> float:
        """Impact velocity [m/s]."""
        return float(self.name.partition("-")[2])

    @property
    def reference(self) -> Reference:
        """The reference: measured figures, and the impact in which they were measured."""
        return catalogue.references()[self.name]

    @property
    def measured(self) -> Mapping[str, float]:
        """The figures in Tables 2 to 5, by keys of summary.json; decelerations are positive."""
        return self.reference.figures


_TESTS = (
    PaperTest("paper/rectangular-2.46"),
    PaperTest("paper/rectangular-3.03", 22, 0.0402),
    PaperTest("paper/rectangular-3.60"),
    PaperTest("paper/cylinder-2.32"),
    PaperTest("paper/cylinder-2.94"),
    PaperTest("paper/cylinder-3.32", 24),
    PaperTest("paper/wedge-2.10"),
    PaperTest("paper/wedge-2.86", 26, 0.0483),
    PaperTest("paper/wedge-3.60"),  # sinks deeper than the block's height
)
TESTS: Mapping[str, PaperTest] = MappingProxyType({test.name: test for test in _TESTS})
"""The nine tests by name, in the tables' order (captions of Figs 22 and 26)."""

NAMES: tuple[str, ...] = tuple(TESTS)


def test_of(scene: Scene) -> PaperTest | None:
    """The test that a scene computes, whatever its name; None if it is none of the nine.

    A scene is a test if its impactor, block, foam (Table 1), rig and start are those of the test,
    and its velocity is within 0.5 %. Mesh, steps, outputs and model choices that the paper leaves
    open (`CHOICE_SETS`, seeds and scatter of strengths, ...) may differ.
    """
    found = catalogue.reference_of(scene)
    return None if found is None or found.name is None else TESTS.get(found.name)


def paper_scene(name: str, choices: str = "calibrated") -> Scene:
    """Return one of the nine tests.

    Args:
        name: one of `NAMES`, e.g. "paper/wedge-2.86".
        choices: a key of `CHOICE_SETS`. "paper-literal" also takes the cylinder's radius from the
            wording of section 3.1.

    Raises:
        UserError: unknown name or choice set.
    """
    if name not in TESTS:
        raise UserError(f"{name}: not one of the paper's tests; choose from {', '.join(NAMES)}")
    return catalogue.load_scene(name, choices)


def brief(name: str) -> str:
    """A test's name in messages and as a folder: wedge-2.86 for "paper/wedge-2.86"."""
    return name.removeprefix("paper/")


def case_names(cases: Sequence[str] | None) -> list[str]:
    """Full names of tests given with or without "paper/"; all nine for None.

    Raises:
        UserError: an unknown name, or no names at all.
    """
    if cases is None:
        return list(NAMES)
    listed = ", ".join(map(brief, NAMES))
    wanted = [case.strip() for case in cases if case.strip()]
    if not wanted:
        raise UserError(f"cases: none given; choose from {listed}")
    full = [f"paper/{brief(case)}" for case in wanted]
    for given, name in zip(wanted, full, strict=True):
        if name not in NAMES:
            near = difflib.get_close_matches(name, NAMES, n=1, cutoff=0.5)
            guess = f"did you mean {brief(near[0])}? " if near else ""
            raise UserError(f"cases: {given!r} is not a test; {guess}Choose from {listed}")
    return list(dict.fromkeys(full))
