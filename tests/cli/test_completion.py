# SPDX-License-Identifier: MIT
"""The completion scripts, in the shells themselves."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from bitneat.cli import completion
from bitneat.cli.main import COMMANDS, build_parser, main
from bitneat.evolve.config import preset_names
from bitneat.verify.targets import TARGETS

ASK_BASH = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
"$(complete -p bitneat | sed 's/.*-F \\([^ ]*\\).*/\\1/')" bitneat
printf '%s\\n' "${COMPREPLY[@]}"
"""

# In a terminal of its own; it waits for the completed line, and would wait for ever.
ASK_ZSH = r"""
zmodload zsh/zpty
zpty shell zsh -f -i
zpty -w shell "PROMPT=; unsetopt zle_bracketed_paste; fpath=($1 \$fpath); autoload -Uz compinit; compinit -D -u"
zpty -w shell "cd $2; print rea''dy"
zpty -r shell said '*ready*'
zpty -w -n shell "$3"$'\t'
zpty -r shell said "*$4*"
zpty -d shell
"""


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scripts")
    for shell in completion.SHELLS:
        (folder / f"bitneat.{shell}").write_text(completion.script(shell))
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("champion.pkl", "champion.json", "walker.c", "map.toml", "notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "runs").mkdir()
    return tmp_path


CASES = [
    (["ver"], {"verify"}, set()),
    (["verify", "--epi"], {"--episodes"}, set()),
    (["verify", "ch"], {"champion.pkl", "champion.json"}, set()),
    (["verify", "no"], set(), {"notes.txt"}),
    (["verify", "--c", "wal"], {"walker.c"}, set()),
    (["verify", "--targets", "cortex-m"], {name for name in TARGETS if name.startswith("cortex")}, {"avr"}),
    (["codegen", "champion.pkl", "--style", "t"], {"table"}, {"unrolled"}),
    (["codegen", "champion.pkl", "--sensor", "m"], {"map.toml"}, set()),
    (["evolve", "--config", "paper-"], {name for name in preset_names() if name.startswith("paper-")}, {"default"}),
    (["polish", "champion.pkl", "champion.j"], {"champion.json"}, {"champion.pkl"}),
    (["completion", "z"], {"zsh"}, {"bash"}),
]


def ask(shell: str, script: Path, words: list[str], folder: Path) -> set[str]:
    """What the shell offers for the last word; descriptions and marks of folders are taken off."""
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not there; tools/install-debian-tools.sh installs it")
    line = ["bitneat", *words]
    if shell == "bash":
        command = [program, "--norc", "-c", ASK_BASH, "bash", str(script), *line]
    else:
        command = [program, "--no-config", "-c", f"source {script}; complete -C '{' '.join(line)}'"]
    environment = {**os.environ, "HOME": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True, timeout=60)
    return {offer.split("\t")[0] for offer in done.stdout.splitlines() if offer}


@pytest.mark.parametrize(("words", "offered", "never"), CASES, ids=[" ".join(case[0]) for case in CASES])
@pytest.mark.parametrize("shell", ["bash", "fish"])
def test_a_shell_offers_commands_options_values_and_files(
    shell: str, words: list[str], offered: set[str], never: set[str], scripts: Path, folder: Path
) -> None:
    offers = ask(shell, scripts / f"bitneat.{shell}", words, folder)
    assert offered <= offers
    assert not never & offers
    if words[-1].startswith("--") or len(words) == 1:
        assert offers == offered


def test_every_command_and_each_of_its_options_is_in_every_script(scripts: Path) -> None:
    subparsers = build_parser(tuple(COMMANDS))._subparsers
    assert subparsers is not None
    parsers = subparsers._group_actions[0].choices
    assert parsers is not None
    for shell in completion.SHELLS:
        text = (scripts / f"bitneat.{shell}").read_text()
        for name in COMMANDS:
            assert name in text
            for action in parsers[name]._actions:  # type: ignore[index]
                for option in action.option_strings:
                    assert (option.lstrip("-") if shell == "fish" else option) in text


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("bitneat codegen champion.p", "bitneat codegen champion.pkl"),
        ("bitneat verify --epi", "bitneat verify --episodes"),
    ],
)
def test_a_real_zsh_completes_at_its_prompt(typed: str, completed: str, scripts: Path, folder: Path) -> None:
    zsh = shutil.which("zsh")
    if zsh is None:
        pytest.skip("zsh is not there; tools/install-debian-tools.sh installs it")
    functions = folder / "functions"
    functions.mkdir()
    shutil.copy(scripts / "bitneat.zsh", functions / "_bitneat")
    command = [zsh, "-f", "-c", ASK_ZSH, "zsh", str(functions), str(folder), typed, completed]
    subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)


def test_the_command_prints_the_script(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "bash"]) == 0
    assert capsys.readouterr().out == completion.script("bash") + "\n"
    assert main(["completion", "csh"]) == 2
