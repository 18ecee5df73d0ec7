"""Whatever a scene's file or a setting holds: a scene, or words; never a traceback, never a wait.

`FUZZ=2000 python -m pytest -n 0 tests/scene/test_malformed_scenes.py` tries 2,000 of each kind.
"""

from __future__ import annotations

import os
import string
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_to_toml
from taichi_foam.scene.paths import by_key
from taichi_foam.scene.toml import DEEPEST, LONGEST_LINE, MOST_BYTES
from taichi_foam.shim2000 import impacts as paper

EXAMPLES = int(os.environ.get("FUZZ", "40"))
LONGEST_MESSAGE = 10_000
LONGEST_WAIT = 5.0  # s of processor time, so that what else a machine does counts for little

PAD = {
    "outline": [[-0.1, 0.0], [0.1, 0.0], [0.05, 0.1], [-0.1, 0.1]],
    "holes": [[[-0.02, 0.04], [0.02, 0.04], [0.0, 0.07]]],
    "layers": [{"bottom": 0.0, "top": 0.03, "foam": {"shear_strain": 0.1}, "density": 30.0}],
}
SCENES = [
    *(load_scene(name) for name in (paper.NAMES[0], "paper/cylinder-3.32", "paper/wedge-2.86")),
    load_scene("paper/wedge-2.86").with_values({f"block.{key}": PAD[key] for key in PAD}),
    load_scene("paper/wedge-2.86").with_values({"foam": "rigid-pu-40"}),
]
DATA = [scene.model_dump(exclude_none=True) for scene in SCENES]
TEXTS = [scene_to_toml(scene) for scene in SCENES]
KEYS = sorted(
    {key for data in DATA for key in by_key(data)}
    | {"", ".", "a", "block", "impactor", "block.layers[0]", "block.layers[0].foam", "a[0].b"}
    | {"block.layers[0].foam.shear_strain", "block.layers[1].top", "block.outline[1]", "block.[0]"}
)

numbers = st.one_of(
    st.integers(),
    st.sampled_from([10**18, 2**63, -(2**64), 10**400, 0, -1]),
    st.floats(),
    st.sampled_from([1e308, -1e308, 5e-324, 1e-9, 1e9, 0.5]),
)
words = st.one_of(
    st.text(max_size=20),
    st.sampled_from(["auto", "rebound", "none", "\x1b[2J", "\u202e", "a" * 500, "ﬀ", "\U0010ffff"]),
)
values = st.recursive(
    st.one_of(st.booleans(), numbers, words, st.dates(), st.times()),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(words, inner, max_size=4)),
    max_leaves=8,
)
entries = st.lists(st.fixed_dictionaries({"key": values}, optional={"why": values}), max_size=3)
pieces = st.one_of(
    st.text(alphabet=string.printable, max_size=30),
    st.text(max_size=10),
    st.sampled_from(
        [
            "[" * 3000, "]" * 3000, "a = " + "[" * 3000 + "]" * 3000, "{a=" * 1000,
            "a." * 900 + "b = 1\n", "[" + "a." * 900 + "b]\n", "[block]\n", "width = 1\n",
            "x = 0x" + "f" * 1500, "x = " + "9" * 1900, "x = " + "9" * 5000, '"""', "'''", "\x00",
            "\ufeff", "[[impactor]]\n", "inf", "nan", "1e999", "\r", "=", '"\\uD800"',
        ]
    ),
)  # fmt: skip


def check(load: Callable[[], Scene]) -> None:
    start = time.process_time()
    try:
        scene = load()
    except UserError as error:
        message = str(error)
        assert message
        assert len(message) < LONGEST_MESSAGE
        assert all(line.isprintable() for line in message.splitlines())
    else:
        assert isinstance(scene, Scene)
    assert time.process_time() - start < LONGEST_WAIT


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenes")


@settings(max_examples=EXAMPLES)
@given(st.data())
def test_odd_values_in_a_file(folder: Path, data: st.DataObject) -> None:
    """Some values of a good scene are others, of any type; some keys are new."""
    found = dict(by_key(data.draw(st.sampled_from(DATA))))
    found |= data.draw(st.dictionaries(st.sampled_from(KEYS), values, min_size=1, max_size=5))
    if data.draw(st.booleans()):
        found["assumed"] = data.draw(entries)
    tree: dict = {}
    for key, value in found.items():
        *heads, last = key.split(".")
        table = tree
        for head in heads:
            table = table[head] if isinstance(table.get(head), dict) else table.setdefault(head, {})
            if not isinstance(table, dict):
                break
        else:
            table[last] = value
    try:
        text = tomli_w.dumps(tree)
    except ValueError:  # a whole number that Python does not write
        return
    file = folder / "odd.toml"
    file.write_text(text, encoding="utf-8", errors="surrogatepass")
    check(lambda: load_scene(file))


@settings(max_examples=EXAMPLES, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_odd_text_in_a_file(folder: Path, data: st.DataObject) -> None:
    """Pieces of a good file are cut out, doubled, or replaced by others, valid TOML or not."""
    text = data.draw(st.sampled_from(TEXTS))
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        stop = data.draw(st.integers(start, min(len(text), start + 60)))
        piece = data.draw(st.one_of(pieces, st.just(text[start:stop] * 2)))
        text = text[:start] + piece + text[stop:]
    encoding = data.draw(st.sampled_from(["utf-8"] * 6 + ["utf-8-sig", "utf-16", "latin-1"]))
    file = folder / "text.toml"
    file.write_bytes(text.encode(encoding, errors="replace"))
    check(lambda: load_scene(file))


small_numbers = st.one_of(st.integers(-(10**30), 10**30), st.floats()).map(str)
overrides = st.one_of(
    st.builds("{}={}".format, st.sampled_from(KEYS), st.one_of(pieces, words, small_numbers)),
    st.sampled_from(
        ["impactor.shape=[1]", "impactor.shape={a=1}", "foam.law=1", "a." * 9000 + "a=1"]
    ),
    pieces,
)


@settings(max_examples=EXAMPLES)
@given(
    st.sampled_from(["paper/wedge-2.86", "gallery/flat-tall-block"]),
    st.lists(overrides, min_size=1, max_size=4),
)
def test_odd_settings(source: str, texts: list[str]) -> None:
    check(lambda: load_scene(source, overrides=texts))


ATTACKS = {
    "arrays thousands deep": ("a = " + "[" * 900, "more than 20 deep"),
    "closed arrays thousands deep": ("\n".join(["a = ["] + ["["] * 5000 + ["]"] * 5001), "20 deep"),
    "tables thousands deep": ("[" + "a." * 900 + "a]", "more than 20 deep"),
    "a key of 40 kB": ("a." * 20_000 + "a = 1", "line 1 has 40,005 characters; at most 2,000"),
    "digits": ("[block]\ncolumns = " + "9" * 1_900, "block.columns = 9999"),
    "thousands of digits": ("[block]\nx = 1\ncolumns = 0x" + "f" * 1_900, "block.columns = "),
    "digits beyond any line": ("[block]\ncolumns = " + "9" * 5_000, "line 2 has 5,010 characters"),
    "many unknown keys": ("\n".join(f"k{n} = 1" for n in range(15_000)), "15,000 problems in all"),
    "a list of shapes": ("[impactor]\nshape = [1]", "impactor.shape = [1]: must be one of flat"),
    "a table of shapes": ("[impactor]\nshape = {a = 1}", "impactor.shape = {'a': 1}: must be one"),
    "a shape of no letters": ("[impactor]\nshape = ''", "impactor.shape = '': must be one of flat"),
    "a key for terminals": ('"\\u001b[2J" = 1', r"\x1b[2J: unknown key"),
    "a long file": ("# " + "long\n" * 50_000, "longer than 200,000 bytes"),
}


@pytest.mark.parametrize("case", ATTACKS)
def test_attacks(case: str, tmp_path: Path) -> None:
    text, fragment = ATTACKS[case]
    file = tmp_path / "attack.toml"
    file.write_text(text)
    start = time.process_time()
    with pytest.raises(UserError) as refusal:
        load_scene(file)
    assert time.process_time() - start < LONGEST_WAIT
    assert fragment in str(refusal.value)
    assert len(str(refusal.value)) < LONGEST_MESSAGE


def test_the_worst_that_the_bounds_let_through(tmp_path: Path) -> None:
    """The file as long as can be, of the longest dotted keys."""
    line = "a." * (LONGEST_LINE // 2 - 20)
    count = MOST_BYTES // LONGEST_LINE
    file = tmp_path / "worst.toml"
    file.write_text("".join(f"{line}k{n} = 1\n" for n in range(count)))
    check(lambda: load_scene(file))


@pytest.mark.parametrize("key", ["a." * DEEPEST + "a.a", "a." * 20_000 + "a", "b" * 100_000])
def test_long_keys_from_python(key: str) -> None:
    start = time.process_time()
    with pytest.raises(UserError) as refusal:
        SCENES[0].with_values({key: 1})
    assert len(str(refusal.value)) < 1_000
    assert time.process_time() - start < LONGEST_WAIT


def test_a_hundred_thousand_unknown_keys() -> None:
    start = time.process_time()
    with pytest.raises(UserError, match="100,000 problems in all"):
        SCENES[0].with_values({f"key{n}": 1 for n in range(100_000)})
    assert time.process_time() - start < LONGEST_WAIT


def test_a_byte_order_mark_is_no_statement(tmp_path: Path) -> None:
    file = tmp_path / "marked.toml"
    file.write_text(TEXTS[0], encoding="utf-8-sig")
    assert load_scene(file) == SCENES[0]


@pytest.mark.parametrize(
    ("encoding", "words_"),
    [
        ("utf-16", "UTF-16 text; save it as UTF-8"),
        ("utf-32", "UTF-32 text; save it as UTF-8"),
        ("latin-1", "not UTF-8 text"),
        ("cp1252", "not UTF-8 text"),
        ("utf-16-le", "not UTF-8 text"),
    ],
)
def test_other_encodings_are_told(encoding: str, words_: str, tmp_path: Path) -> None:
    file = tmp_path / "other.toml"
    file.write_bytes('name = "Würfel"\n'.encode(encoding))
    with pytest.raises(UserError, match=words_):
        load_scene(file)


def test_settings_and_names_that_cannot_be() -> None:
    with pytest.raises(UserError, match=r"impactor\.shape = \[1\]: must be one of flat"):
        load_scene("paper/wedge-2.86", overrides=["impactor.shape=[1]"])
    with pytest.raises(UserError, match="value of 5,000 characters; at most 2,000"):
        load_scene("paper/wedge-2.86", overrides=["block.rows=" + "9" * 5_000])
    with pytest.raises(UserError, match="no such file"):
        load_scene("x" * 5_000)
    with pytest.raises(UserError, match="no such file"):
        load_scene("a\0b")
