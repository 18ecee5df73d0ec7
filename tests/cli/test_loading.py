"""What the command line loads: help, versions and mistyped words wait for no library."""

from __future__ import annotations

import pytest
from command_line import call
from typer.testing import CliRunner

from taichi_foam.choices import CHOICE_SETS
from taichi_foam.cli import app

_HEAVY = {
    "taichi", "numpy", "scipy", "matplotlib", "shapely", "PIL", "imageio", "jinja2",
    "taichi_foam.scene",
}  # fmt: skip

_LOADED = f"""
import sys
from taichi_foam.cli import main
try:
    main()
finally:
    print("loaded:", *sorted({_HEAVY} & set(sys.modules)))
"""


def _commands() -> list[list[str]]:
    """Every command there is, as its words."""
    names: list[list[str]] = []
    for info in app._app.registered_commands:
        assert info.name is not None
        names.append([info.name])
    for group in app._app.registered_groups:
        assert group.name is not None
        assert group.typer_instance is not None
        names += [[group.name, each.name] for each in group.typer_instance.registered_commands]
    return names


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--help"], 0, "Usage: taichi-foam"),
        (["--version"], 0, "taichi-foam"),
        (["runn"], 2, "No such command"),
        (["run"], 2, "Missing argument"),
        (["run", "--choices"], 2, "--choices"),
        (["foam", "import", "--help"], 0, "mm/mm"),
        (["render", "--help"], 0, "worst-strain"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_words_about_commands_load_nothing_heavy(words: list[str], code: int, said: str) -> None:
    done = call("-c", _LOADED, *words)
    assert done.returncode == code
    assert said in done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "loaded:"


def test_the_list_of_heavy_libraries_is_of_use() -> None:
    """A command that does load some is caught by the same script."""
    done = call("-c", _LOADED, "foam", "show", "rigid-pu-30")
    assert {"numpy", "taichi"} <= set(done.stdout.splitlines()[-1].split())


def test_every_command_has_its_help() -> None:
    """And all of them in one process, with what a scene may say where it is chosen from."""
    commands = _commands()
    assert ["run"] in commands
    assert ["foam", "import"] in commands
    for words in commands:
        shown = CliRunner().invoke(app._app, [*words, "--help"])
        assert shown.exit_code == 0
        if "--choices" in shown.stdout:
            assert "|".join(CHOICE_SETS) in shown.stdout
