"""The reference of a scene's keys: tables for the terminal, and the page docs/scene.md."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from taichi_foam.errors import UserError
from taichi_foam.scene import CHOICE_SETS, Scene
from taichi_foam.scene.keys import REQUIRED, Key, keys, listed, written
from taichi_foam.scene.messages import nearest, shown

COMMAND = "taichi-foam keys --markdown > docs/scene.md"
"""The command that writes the page."""

_INTRODUCTION = f"""\
# What a scene says

Written by `{COMMAND}`; `taichi-foam keys` prints the same tables on the terminal.

A **scene** is one impact on one block of foam: everything that determines its result. Every key
has a default, and a scene states only what differs. It needs an impactor, or a time at which the
run ends (`numerics.end`). Unknown keys and invalid values are refused with a message that names the
allowed range and a fix. What a scene cannot describe is listed in [limits.md](limits.md).

**Units are SI**: metres, seconds, kilograms, pascals; angles are in degrees. Strains are fractions,
positive in tension. The impactor's velocity is positive downwards. The origin is at the middle of
the block's bottom, with x to the right and y up.

## How it is written

In TOML, each part is a table:

```toml
name = "Cylinder on a wide block"

[block]
width = 0.3
columns = 60

[impactor]
shape = "cylinder"
radius = 0.03
velocity = 2.5
```

`taichi-foam run FILE` runs it; `--set impactor.velocity=3` changes a single value. The same in
Python (a script that defines `scene` can be run like a TOML file):

```python
import taichi_foam as tf
from taichi_foam.scene import Block, Cylinder

scene = tf.Scene(
    name="Cylinder on a wide block",
    block=Block(width=0.3, columns=60),
    impactor=Cylinder(radius=0.03, velocity=2.5),
)
faster = scene.with_values({{"impactor.velocity": 3.0}})  # or with_values(impactor__velocity=3.0)
```

A default of `none` means that no value is given. `--set foam.rate=none`, and `None` in
`with_values`, return to it; in TOML, leave the key out, or write `"none"` in a foam's table. A new
`impactor.shape` drops the keys that the new shape does not have.

## Foams by name, from a file, or from a test

`foam = "NAME"` selects a foam from the library, `foam = "FILE.toml"` a foam file in the scene's
folder; both include the density. Your own values take precedence over theirs, and `"none"` takes an
optional one out, such as `rate = "none"`:

```toml
[foam]
like = "shim2000-pu"
shear_modulus = 1.0e6
```

`curve = "test.csv"` is a compression test in the scene's folder, for the law `tabulated`. Units are
given in the header (`strain [%],stress [MPa]`) or by keys,
`curve = {{ file = "test.csv", strain_unit = "%", stress_unit = "MPa" }}`. Displacement and force
are converted to strain and stress with the specimen's area [m2] and height [m]:
`curve = {{ file = "test.csv", area = 2.5e-3, height = 0.05 }}`. Text above the header is skipped;
the file may be in UTF-8 or Latin-1. The curve is the loading envelope: unloading is left out.
`taichi-foam foam import` reports everything that it reads. In Python, write
`TabulatedFoam(curve=Curve(strain=..., stress=...))`, with both names from `taichi_foam.scene`. If
only some constants of a foam are given, the others are derived or assumed, and a run reports them
(`assumed`; `taichi-foam foam assumed RUN_DIR` lists them).

## Pads

`block.outline` and `block.holes` are lists of corners, `block.layers` is a list of tables
(`[[block.layers]]`) with the keys below; [pads.md](pads.md) explains how pads are drawn. An entry
of a list is addressed by its index, from 0: `--set block.layers[0].density=40`.

## Reference

What was measured in an impact can be written into its scene, and is then shown beside what is
computed:

```toml
[reference]
source = "our laboratory, 12 March"

[reference.figures] # by the keys of summary.json
max_displacement_m = 0.031
impact_duration_s = 0.024
```

A reference belongs to the impact, not to the name of the scene: if the impact is changed (impactor,
block, foam, base or start; the velocity by more than 0.5 %), nothing is compared. Changes of mesh,
time step, output and model choices do not matter, nor do foam values that a test does not provide.
In a resolved scene, `velocity` and `impact`, a digest, identify the impact. `title` is the name of
the scene in pictures; `readings` are values, by choice set, with which the measured figures still
apply. The nine scenes in `scenes/paper` show both. A scene without a reference is compared with the
one of these nine that has the same impact, if any.

## Choice sets

The paper leaves some things open. Two named sets of model choices settle them: `--choices NAME`, or
`tf.load_scene(source, choices=NAME)`. A set overrides the scene's values of the keys below; `--set`
overrides both. Without a set, a scene keeps its own values and the defaults. The paper's nine tests
use `calibrated` unless another set is requested; with `paper-literal`, their cylinder also has a
radius of 5 cm. [model.md](model.md#model-choices) gives the reasons. In an empty cell, the set
leaves the key as it is.
"""

_UNITS = (
    "In the column *unit*, - marks a dimensionless number; an empty cell marks a value that is "
    "not a number."
)


def described(part: str) -> str:
    """Description of a part of a scene; "scene" stands for keys outside any part."""
    if part in listed(Scene):
        return f"each entry of the list {part[:-2]}"
    field = Scene.model_fields.get(part)
    return "keys outside the parts" if field is None else field.description or ""


def keys_of(name: str | None = None) -> list[Key]:
    """Every key of a scene, the keys of the part `name`, or the key `name`.

    Raises UserError for a name that is neither, with the most similar one.
    """
    known = list(keys(Scene))
    found = [key for key in known if name in (None, key.part, key.key)]
    if name is None or found:
        return found
    parts = {key.part: key.part for key in known}
    beside = {
        key.key.rpartition(".")[2]: key.key for key in known if name.startswith(key.part + ".")
    }
    near = nearest(name, beside or parts, Scene)
    guess = f"did you mean {near}? " if near else ""
    raise UserError(
        f"{shown(name)}: neither a part nor a key of a scene; {guess}the parts are "
        f"{', '.join(parts)}"
    )


def tables_of(name: str | None = None) -> Iterator[RenderableType]:
    """These keys as tables for the terminal, part by part. Raises UserError as `keys_of`."""
    for part, having in groupby(keys_of(name), key=lambda key: key.part):
        yield from _listed_part(f"{part}: {described(part)}", list(having))


def _listed_part(title: str, keys: Sequence[Key]) -> Iterator[RenderableType]:
    """A heading, then two rows for each key: its columns, and below them the meaning."""
    yield Text(title, style="bold")
    heads = ("key", "unit", "default", "allowed")
    rows = [(key.key, key.unit, key.default, key.allowed) for key in keys]
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)][:-1]
    yield _columns(heads, widths, "dim")
    for key, row in zip(keys, rows, strict=True):
        yield _columns(row, widths)
        yield Padding(Text(key.about), (0, 0, 0, 4), expand=False)
    yield Text()


def _columns(cells: Iterable[str], widths: Sequence[int], style: str = "") -> Table:
    """A line of columns of these widths, and a last one that takes the rest."""
    row = Table(box=None, show_header=False, pad_edge=False)
    for width in widths:
        row.add_column(width=width, no_wrap=True)
    row.add_column()
    row.add_row(*map(Text, cells), style=style)
    return row


def page() -> str:
    """The page docs/scene.md, in Markdown."""
    return "\n".join([_INTRODUCTION, *_choice_sets(), "", "## Keys", "", _UNITS, *_parts()]) + "\n"


def _choice_sets() -> Iterator[str]:
    """The keys that choice sets change, with each set's value beside the default."""
    # of a key that several laws have, the default of the first: `[foam]` has that law by default
    default = {key.key: key.default for key in reversed([*keys(Scene)])}
    rows = []
    for key in dict.fromkeys(key for chosen in CHOICE_SETS.values() for key in chosen):
        values = [written(chosen[key]) if key in chosen else "" for chosen in CHOICE_SETS.values()]
        rows.append([_code(key), *map(_code, [default[key], *values])])
    return _table(["key", "default", *map(_code, CHOICE_SETS)], rows)


def _parts() -> Iterator[str]:
    """The keys of each part under a heading."""
    for part, having in groupby(keys(Scene), key=lambda key: key.part):
        about = described(part)
        yield from ("", f"### {part}", "", f"{about[:1].upper()}{about[1:]}.", "")
        rows = [
            [_code(key.key), key.unit, _code(key.default), key.allowed, key.about] for key in having
        ]
        yield from _table(["key", "unit", "default", "allowed", "meaning"], rows)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    for cells in (heads, ["---"] * len(heads), *rows):
        yield f"| {' | '.join(cells)} |"


def _code(text: str) -> str:
    """A literal value, formatted as code."""
    return text if text in ("", REQUIRED) else f"`{text}`"
