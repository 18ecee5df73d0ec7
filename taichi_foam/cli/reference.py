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

A **scene** is one impact on one block of foam: everything that decides its result. Every key has a
default, and a scene says only what differs. It needs an impactor, or a time at which the run ends
(`numerics.end`). An unknown key and a value that cannot be are refused, with what is allowed and
what to do. What no scene can say is in [limits.md](limits.md).

**Units are SI**: metres, seconds, kilograms, pascals; angles in degrees. Strains are fractions,
positive in tension. The impactor's velocity is positive downwards. The frame: x to the right from
the block's mid-width, y up from its bottom.

## How it is written

In TOML, a table for each part:

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

`taichi-foam run FILE` runs it, with `--set impactor.velocity=3` for single values. In Python, where
a script that defines `scene` is as good as a TOML file:

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

A default of `none` means that nothing is given. `--set foam.rate=none`, and `None` in
`with_values`, go back to that; in TOML one leaves the key out. A new `impactor.shape` drops the
keys that it lacks.

## Foams by name, in files, by their test

`foam = "NAME"` stands for a foam of the library, `foam = "FILE.toml"` for a foam file beside the
scene; both bring their density. Values of one's own go before theirs:

```toml
[foam]
like = "shim2000-pu"
shear_modulus = 1.0e6
```

`curve = "test.csv"` is a compression test beside the scene, with the law `tabulated`. Units stand
in the header (`strain [%],stress [MPa]`) or in keys,
`curve = {{ file = "test.csv", strain_unit = "%", stress_unit = "MPa" }}`. Displacement and force
become strain and stress by the specimen's area [m2] and height [m]:
`curve = {{ file = "test.csv", area = 2.5e-3, height = 0.05 }}`. Text above the header is skipped,
UTF-8 and Latin-1 are read. The curve is the loading envelope: unloading is left out.
`taichi-foam foam import` says all that it reads. In Python it is
`TabulatedFoam(curve=Curve(strain=..., stress=...))`, both from `taichi_foam.scene`. Of a foam of
which some constants were given, the others are derived or assumed, and a run says so (`assumed`;
`taichi-foam foam assumed RUN_DIR` lists them).

## Pads

`block.outline` and `block.holes` are lists of corners, `block.layers` a list of tables
(`[[block.layers]]`) with the keys below; [pads.md](pads.md) tells how pads are drawn. A value
within a list is reached by its place, from 0: `--set block.layers[0].density=40`.

## Reference

What was measured in an impact stands in its scene, and is then shown beside what is computed:

```toml
[reference]
source = "our laboratory, 12 March"

[reference.figures] # by the keys of summary.json
max_displacement_m = 0.031
impact_duration_s = 0.024
```

It belongs to the impact, not to the name: where the scene is changed into another one (impactor,
block, foam, what holds it, start; velocity by more than 0.5 %) nothing is compared. Mesh, steps,
outputs and model choices do not count, nor what a test of a foam does not give. In a resolved scene
`velocity` and a digest, `impact`, tell which impact it was. `title` is what a scene of this name is
called in pictures; `readings` are values that a set of choices takes, under which the figures still
hold. The nine scenes in `scenes/paper` show both. A scene without a reference is compared with that
one of them which has its impact, if any.

## Choice sets

The paper leaves some things open. Two named sets of model choices settle them: `--choices NAME`, or
`tf.load_scene(source, choices=NAME)`. A set replaces what the scene says of these keys; `--set`
comes after it and has the last word. Without a set a scene keeps its own values and the defaults.
The paper's nine tests are `calibrated` unless another set is asked for; with `paper-literal` their
cylinder has a radius of 5 cm, too. [model.md](model.md#model-choices) has the reasons. An empty
cell: the set leaves the key as it is.
"""

_UNITS = "In the column *unit* - stands for a plain number; what has an empty cell is no number."


def described(part: str) -> str:
    """Description of a part of a scene; "scene" stands for keys outside any part."""
    if part in listed(Scene):
        return f"each entry of the list {part[:-2]}"
    field = Scene.model_fields.get(part)
    return "what is in no part" if field is None else field.description or ""


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
        f"{shown(name)}: no part and no key of a scene; {guess}the parts are {', '.join(parts)}"
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
    default = {key.key: key.default for key in keys(Scene)}
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
