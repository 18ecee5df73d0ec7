"""Scenes of drops on cushions, as cushion curves and designs compute them.

A flat pad under a wider level product is crushed in one dimension: the lattice has no Poisson's
ratio, so a strip of a few columns stops with the same peak, to 1e-4, as the whole pad. That is what
is computed. The other pads are computed as wide as they are, in cells of a twelfth of the
thickness.

A pad's thickness is the foam between product and base. The static stress is the product's weight
over the area that it rests on, `width` x `depth`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError
from taichi_foam.formulas.energy import check_above_0
from taichi_foam.laws.bond import BondFoam
from taichi_foam.scene import Scene
from taichi_foam.scene.library import is_test, read_corners
from taichi_foam.units import STANDARD_GRAVITY, rounded

Array = NDArray[np.float64]

Corners = list[tuple[float, float]]

SIDE = 0.2
"""Usual width and depth of a pad [m]; specimens of ASTM D1596 are 8 inches square."""

ROWS, COLUMNS = 20, 4
"""Cells in the height and in the width of the strip that stands for a flat pad."""

CELLS = 12
"""Cells in the thickness of any other pad."""

FLAT = "flat"

LONGEST = 0.5
"""Longest time of a drop [s]; the run itself ends when the product has come to rest."""

_STRAINS = 4001  # at which a foam's stress is evaluated


def cushion_scene(
    foam: Any,
    thickness: float,
    drop_height: float,
    static_stress: float,
    *,
    shape: str | Path | Sequence[tuple[float, float]] = FLAT,
    width: float = SIDE,
    depth: float = SIDE,
    density: float | None = None,
    cell: float | None = None,
) -> Scene:
    """A product falls straight on to a fresh pad, on rails and with a level face.

    Args:
        foam: name in the foam library, foam file (.toml) or compression test (.csv), each also as
            a path; or anything that a scene's `foam` takes: a mapping or a law with its constants.
        thickness: m, of the foam beneath the product.
        drop_height: m, of the fall that ends at first contact.
        static_stress: Pa, the product's weight over the area `width` x `depth` that it rests on.
        shape: "flat": a level pad under a wider product; "edge": an L beneath and beside a
            product's edge, half as thick beside it and as high as the pad is thick; "rib": a pad
            on ribs, half of its height and of its width; otherwise corners (x, y) of an outline,
            or a CSV file of them. An outline is drawn at any size: it is scaled to the
            thickness, and its own width replaces `width`.
        width: m, of the pad under the product, in the plane.
        depth: m, across the plane.
        density: kg/m3, of the foam; None: that of the foam file, or else of the paper's foam.
        cell: m, edge of the lattice's cells; None: see the module.

    Raises:
        UserError: an unknown shape, foam or file, or a value out of its range.
    """
    check_above_0(
        thickness=thickness, drop_height=drop_height, static_stress=static_stress, width=width,
        depth=depth,
    )  # fmt: skip
    block: dict[str, Any] = {"height": thickness, "depth": depth}
    middle = 0.0
    if isinstance(shape, str) and shape == FLAT:
        cell = thickness / ROWS if cell is None else cell
        width = rounded(COLUMNS * cell, 12)
        block |= {"width": width, "columns": COLUMNS, "rows": max(1, round(thickness / cell)) + 1}
        plate = 2.0 * width
    else:
        corners, width, plate, middle = _pad(shape, thickness, width)
        block["outline"] = corners
        left, right = min(x for x, _ in corners), max(x for x, _ in corners)
        block |= {"width": rounded(right - left, 12), "height": max(y for _, y in corners)}
        block["cell"] = rounded(thickness / CELLS, 12) if cell is None else cell
    if density is not None:
        block["density"] = density
    data = {
        "name": "cushion",
        "block": block,
        "foam": {"curve": foam} if is_test(foam) else foam,
        "impactor": {
            "shape": "flat",
            "width": rounded(plate, 12),
            "height": max(0.02, thickness),
            "x": rounded(middle, 12),
            "mass": rounded(static_stress * width * depth / STANDARD_GRAVITY, 12),
            "drop_height": drop_height,
        },
        "numerics": {"time_limit": LONGEST},
        "output": {"film": False, "snapshot_interval": 0.005},
    }
    return Scene.checked(data, "cushion")


def stress_curve(scene: Scene) -> tuple[Array, Array]:
    """(n,) strains and stresses [Pa] of a scene's foam, positive in compression, to its locking.

    Raises UserError: its law states no stress.
    """
    strain = np.linspace(0.0, min(-scene.foam.landmarks.limit, 1.0), _STRAINS)
    return strain, stress_over(scene.foam, strain, "foam")


def stress_over(foam: BondFoam, strain: Array, asked: str) -> Array:
    """(n,) stresses [Pa] of a foam at strains (n,), both positive in compression.

    Raises UserError, which begins with `asked`: its law states no stress.
    """
    stress = foam.loading(strain)
    if stress is None:
        raise UserError(
            f"{asked}: its law {foam.law!r} states no stress over strain, which the energy balance "
            "needs; choose a foam with a curve (`taichi-foam foam list`)"
        )
    return stress


def called(foam: Any) -> str:
    """What a foam is called in titles and folders: as it was asked for; of a file, its name."""
    if isinstance(foam, str | Path):
        return Path(foam).stem if str(foam).lower().endswith((".csv", ".toml")) else str(foam)
    return "foam of one's own"


def _pad(
    shape: str | Path | Sequence[tuple[float, float]], thickness: float, width: float
) -> tuple[Corners, float, float, float]:
    """Corners of a pad, the width the product rests on, the product's width and its middle [m]."""
    if isinstance(shape, str) and shape in _DRAWN:
        return _DRAWN[shape](thickness, width)
    corners = _scaled(_read(shape), thickness)
    own = max(x for x, _ in corners) - min(x for x, _ in corners)
    return corners, own, 1.2 * own, 0.0


def _edge(thickness: float, width: float) -> tuple[Corners, float, float, float]:
    """An L below and beside a product's edge; a clearance of a cell keeps it off the side."""
    beside, clearance = thickness / 2, thickness / CELLS
    left, right = -(width + beside) / 2, (width + beside) / 2
    inner = left + beside
    corners = [
        (left, 0.0),
        (right, 0.0),
        (right, thickness),
        (inner, thickness),
        (inner, 2 * thickness),
        (left, 2 * thickness),
    ]
    plate = width + thickness  # it overhangs the open side
    return corners, width, plate - clearance, inner + clearance + (plate - clearance) / 2


def _rib(thickness: float, width: float) -> tuple[Corners, float, float, float]:
    """A pad on ribs as wide as the gaps between them, about as wide as they are tall."""
    tall = thickness / 2
    count = max(2, round(width / (2 * tall)))
    pitch = width / count
    corners: Corners = [(-width / 2, thickness)]
    for n in range(count):
        x = -width / 2 + n * pitch
        first, last = x + pitch / 4, x + 3 * pitch / 4
        corners += [(first, tall), (first, 0.0), (last, 0.0), (last, tall)]
    corners[1:1] = [(-width / 2, tall)]
    corners += [(width / 2, tall), (width / 2, thickness)]
    return corners, width, 1.2 * width, 0.0


_DRAWN: dict[str, Callable[[float, float], tuple[Corners, float, float, float]]] = {
    "edge": _edge,
    "rib": _rib,
}

SHAPES = (FLAT, *_DRAWN)
"""Names of shapes."""


def _read(shape: Any) -> Corners:
    """The corners of an outline, given as such or in a file."""
    if isinstance(shape, str | Path):
        if not str(shape).lower().endswith(".csv"):
            raise UserError(
                f"shape = {str(shape)!r}: must be {', '.join(SHAPES)}, or a CSV file with the "
                "corners of an outline, its columns x and y. Fix: choose one of them"
            )
        return read_corners(Path(shape))
    try:
        return [(float(x), float(y)) for x, y in shape]
    except (TypeError, ValueError):
        raise UserError(
            f"shape = {shape!r}: must be {', '.join(SHAPES)}, or corners (x, y) in m. "
            "Fix: give pairs of numbers, such as [(0, 0), (0.1, 0), (0.1, 0.05)]"
        ) from None


def _scaled(corners: Corners, thickness: float) -> Corners:
    """An outline with its height scaled to a thickness, on the base and about its mid-width."""
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    height = max(ys) - min(ys) if ys else 0.0
    if height <= 0.0:
        raise UserError("shape: the outline has no height. Fix: give at least three corners")
    scale, middle = thickness / height, (max(xs) + min(xs)) / 2
    return [(scale * (x - middle), scale * (y - min(ys))) for x, y in corners]
