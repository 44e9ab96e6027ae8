# SPDX-License-Identifier: MIT
"""The comparison with other generators: its networks, its counting, and the page's section."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers.candidate import Candidate, CannotExpressError
from benchmarks.peers.emlearn_code import perceptron
from benchmarks.peers.networks import ROOT, dense, levels, netb, networks
from benchmarks.peers.report import END, GENERATORS, START, replaced
from bitneat.controller import Controller, Input, Link, Node, Reference, Signal

measured = pytest.mark.skipif(
    find_spec("unicorn") is None or shutil.which("arm-none-eabi-gcc") is None,
    reason="needs unicorn (pip install -e '.[peers]') and arm-none-eabi-gcc",
)


def test_netb_is_the_file_and_dense_has_no_zero() -> None:
    data = json.loads((ROOT / "benchmarks" / "netb.json").read_text())
    links = [[link.source, 24 + j, link.sign] for j, node in enumerate(netb().nodes) for link in node.links]
    assert sorted(links) == sorted(data["links"])
    assert dense().num_links == 24 * 16 + 16 * 4
    assert all(controller == controller.canonical for controller in networks().values())


def test_a_level_needs_only_inputs_and_earlier_levels() -> None:
    for controller in networks().values():
        known = set(range(len(controller.inputs)))
        for level in levels(controller):
            for signal in level:
                assert {link.source for link in controller.nodes[signal - len(controller.inputs)].links} <= known
            known |= set(level)
        assert len(known) == controller.num_signals


@pytest.mark.parametrize("name", ["netb", "dense 24-16-4"])
def test_the_perceptron_computes_the_network(name: str) -> None:
    controller = networks()[name]
    weights, biases = perceptron(controller)
    rng = np.random.default_rng(1)
    reference = Reference(controller)
    for _ in range(50):
        inputs = rng.integers(-2047, 2048, len(controller.inputs))
        units = inputs / controller.one
        for index, (matrix, bias) in enumerate(zip(weights, biases, strict=True)):
            units = units @ matrix + bias
            if index < len(weights) - 1:
                units = np.maximum(units, 0)
        assert (units * controller.one).tolist() == reference.step(inputs.tolist())


def test_what_is_no_sum_of_relus_is_refused() -> None:
    with pytest.raises(CannotExpressError, match="no sum of ReLUs"):
        perceptron(Controller((Input(),), (Node((Link(0),), activation="step"),), (Signal(1),)))


SIMPLE = Controller((Input(),), (Node((Link(0),)),), (Signal(1),))


@measured
def test_flash_ram_stack_and_instructions_are_those_of_the_program() -> None:
    from benchmarks.peers.measure import measure

    clamp = "int x = input[0]; output[0] = (int16_t)(x > 256 ? 256 : x < -256 ? -256 : x);"
    plain = measure(Candidate("c", "", {}, "", clamp, "int16_t", 256.0), SIMPLE)
    assert plain.largest_difference == 0
    assert 15 < plain.flash < 60
    assert (plain.ram, plain.stack) == (0, 0)
    assert plain.instructions[0] < plain.instructions[1]  # it branches
    more = "static int kept[25]; static const int table[10] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10};"
    used = f"volatile char room[64]; room[0] = 1; kept[input[0] & 15] += table[input[0] & 7]; {clamp}"
    other = measure(Candidate("c", "", {}, more, used, "int16_t", 256.0), SIMPLE)
    assert other.ram == 100
    assert other.flash >= plain.flash + 40
    assert other.stack >= 1
    wrong = measure(Candidate("c", "", {}, "", "output[0] = input[0];", "int16_t", 256.0), SIMPLE)
    assert wrong.largest_difference == (32767 - 256) / 256


@measured
@pytest.mark.parametrize("name", ["bitneat, table", "bitneat, unrolled"])
def test_our_own_code_is_exact_and_takes_the_same_instructions_for_every_input(name: str) -> None:
    from benchmarks.peers.measure import measure

    controller = netb()
    result = measure(GENERATORS[name](controller), controller)
    assert result.largest_difference == 0
    assert result.instructions[0] == result.instructions[1]
    assert result.ram == 0


@measured
@pytest.mark.skipif(find_spec("emx_onnx_cgen") is None, reason="needs emx-onnx-cgen (pip install -e '.[peers]')")
def test_a_peers_code_answers_as_the_network_does() -> None:
    from benchmarks.peers.measure import measure

    controller = dense()
    assert measure(GENERATORS["emx-onnx-cgen, int8"](controller), controller).largest_difference == 0


def test_a_section_is_replaced_and_a_page_without_one_refused() -> None:
    page = f"before\n{START}old\n{END}after\n"
    assert replaced(page, f"{START}new\n{END}") == f"before\n{START}new\n{END}after\n"
    with pytest.raises(ValueError, match="unpack"):
        replaced("nothing\n", "")


def test_the_page_has_a_row_for_each_network_and_generator() -> None:
    page = (ROOT / "docs" / "benchmarks.md").read_text()
    section = page[page.index(START) : page.index(END)]
    for network in networks():
        for name in GENERATORS:
            assert f"| {network} | {name} | " in section


def test_a_missing_package_is_one_line(tmp_path: Path) -> None:
    code = (
        "import sys, importlib.util as u; real = u.find_spec\n"
        "import benchmarks.peers.__main__ as m\n"
        "m.find_spec = lambda name: None if name == 'emlearn' else object()\n"
        "sys.exit(m.main())"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "peers: emlearn missing; pip install 'bitneat[peers]'\n"
