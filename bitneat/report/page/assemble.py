# SPDX-License-Identifier: MIT
"""Putting the page together: one HTML text without a date, a path or anything else that the champion does not decide."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import jinja2
from markupsafe import Markup

from bitneat.champion import Champion, EnvironmentSpec
from bitneat.codegen import GeneratedC, Style, generate
from bitneat.controller import BoxAction, Controller, Signal
from bitneat.controller.packing import Layout
from bitneat.report.page.graph import layout
from bitneat.report.page.highlight import highlighted
from bitneat.report.page.history import LARGEST, History, history_charts, pareto_chart, score
from bitneat.report.page.recording import ANGLE_STEPS, LENGTH_STEPS, RecordedEpisode
from bitneat.report.page.tables import (
    byte_parts,
    encoding_rows,
    flat_rows,
    provenance_rows,
    size_rows,
    verify_facts,
    verify_failures,
    verify_rows,
)
from bitneat.report.page.webassembly import Module, compile_module
from bitneat.sim.bipedal import IDS
from bitneat.sim.names import input_names, output_names
from bitneat.verify.size import SizeReport
from bitneat.verify.wasm import I32_ADD, read_wasm
from bitneat.version import __version__

ASSETS = Path(__file__).with_name("assets")
MAX_PROVENANCE = 20_000
"""Characters of a champion's provenance that are shown."""


@dataclass(frozen=True)
class Sources:
    """What the page is made of.

    ``verification`` is the content of ``verify --json``, and ``proof`` of ``prove --json``, None if there is none. ``others``
    are champions to compare with, by name.
    """

    champion: Champion
    environment: EnvironmentSpec
    episodes: Sequence[RecordedEpisode]
    sizes: SizeReport
    verification: Mapping[str, Any]
    proof: Mapping[str, Any] | None = None
    history: History | None = None
    others: Sequence[tuple[str, Champion]] = ()


@dataclass(frozen=True)
class Page:
    """The page, and the C that it shows: the same that ``codegen`` writes under that name."""

    html: str
    code: GeneratedC


def build_page(sources: Sources) -> Page:
    """Make the page.

    Raises:
        BitneatError: if the controller cannot be generated as C, or not be compiled for the browser.
    """
    champion = sources.champion
    controller = champion.controller.canonical
    code = page_code(champion)
    step, run = compile_module(code, "step"), compile_module(page_code(champion, "table"), "run")
    inputs = input_names(sources.environment, len(controller.inputs))
    outputs = output_names(sources.environment, len(controller.outputs))
    script, style = (ASSETS / "page.js").read_text("utf-8"), _templates().get_template("page.css.j2").render()
    code_sha256 = hashlib.sha256(code.source.encode()).hexdigest()
    html = (
        _templates()
        .get_template("page.html.j2")
        .render(
            policy=_policy(script, style),
            script=Markup(script),
            style=Markup(style),
            data=_json(_data(sources, {"step": step, "run": run}, inputs, outputs)),
            graph=layout(controller, inputs, outputs),
            facts=_facts(sources, controller),
            environment=sources.environment,
            episodes=sources.episodes,
            code=code,
            source=highlighted(code.source),
            header=highlighted(code.header),
            downloads=[(f"{code.name}.c", _data_url(code.source)), (code.header_name, _data_url(code.header))],
            code_sha256=code_sha256,
            module=step,
            byte_parts=byte_parts(sources.sizes.packed[0]),
            encodings_rows=encoding_rows(sources.sizes),
            sizes=size_rows(sources.sizes),
            verification=sources.verification,
            verify_facts=verify_facts(sources.verification, code_sha256),
            verify_failures=verify_failures(sources.verification),
            verify_rows=verify_rows(sources.verification),
            proof=sources.proof,
            proof_rows=flat_rows(sources.proof or {}),
            charts=_charts(sources),
            history=sources.history,
            provenance_rows=provenance_rows(champion.provenance),
            provenance=_shortened(json.dumps(dict(champion.provenance), indent=2, ensure_ascii=False)),
            version=__version__,
        )
    )
    return Page(html, code)


def page_code(champion: Champion, style: Style | Literal["auto"] = "auto") -> GeneratedC:
    """The C that a champion's page shows, runs and has verified: what ``codegen -o walker.c`` writes.

    Raises:
        BitneatError: if no C can be generated, or no compiler is there to choose the style.
    """
    environment_id = champion.environment.id if champion.environment else ""
    name = "walker" if environment_id in IDS else "controller"
    return generate(champion.controller, name, style, action=champion.action, environment_id=environment_id)


@cache
def _templates() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(ASSETS),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=True,
    )


def _policy(script: str, style: str) -> str:
    """The content security policy: the two inline parts by their hashes, WebAssembly, and nothing from anywhere."""
    script_hash, style_hash = (
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii") for text in (script, style)
    )
    return (
        f"default-src 'none'; script-src 'sha256-{script_hash}' 'wasm-unsafe-eval'; style-src 'sha256-{style_hash}'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def _json(data: Any) -> Markup:
    """JSON that can stand in a script element: it holds no ``<``, so it can neither end that nor begin a comment."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def _data(
    sources: Sources, modules: Mapping[str, Module], inputs: Sequence[str], outputs: Sequence[str]
) -> dict[str, Any]:
    """What the script needs."""
    controller = sources.champion.controller.canonical
    place = Layout(controller)
    action = sources.champion.action
    return {
        "fracBits": controller.frac_bits,
        "inputs": [
            {"name": name, "scale": entry.scale, "limit": entry.limit}
            for name, entry in zip(inputs, controller.inputs, strict=True)
        ],
        "nodes": [
            {
                "links": [[link.source, link.sign, link.shift, link.delay] for link in node.links],
                "bias": node.bias,
                "gain": node.gain,
                "activation": node.activation,
            }
            for node in controller.nodes
        ],
        "outputs": [
            {"name": name, "signal": output.index}
            if isinstance(output, Signal)
            else {"name": name, "constant": output.value}
            for name, output in zip(outputs, controller.outputs, strict=True)
        ],
        "action": {"low": list(action.low), "high": list(action.high)} if isinstance(action, BoxAction) else None,
        "slots": [place.slot_of(signal) for signal in range(controller.num_signals)],
        "workspace": place.workspace_length,
        "modules": {
            "step": {**modules["step"].to_data(), "additions": _additions(modules["step"])},
            "run": modules["run"].to_data(),
        },
        "lengthSteps": LENGTH_STEPS,
        "angleSteps": ANGLE_STEPS,
        "framesPerSecond": 50,
        "episodes": [episode.to_data() for episode in sources.episodes],
    }


def _additions(module: Module) -> list[int]:
    """Where the function that computes a step adds: places for a fault that the page can plant."""
    wasm = read_wasm(module.content)
    opcodes = wasm.functions[wasm.exports[module.function] - wasm.first_function]
    return [one.offset for one in opcodes if one.code == I32_ADD]


def _facts(sources: Sources, controller: Controller) -> dict[str, Any]:
    """The few figures at the top."""
    held_out = sources.champion.provenance.get("held_out")
    mean = score(sources.champion, "held_out")
    std, episodes = (held_out.get("std"), held_out.get("episodes")) if isinstance(held_out, Mapping) else (None, None)
    known = mean is not None and isinstance(std, int | float) and type(episodes) is int and 0 <= std <= LARGEST
    return {
        "sha256": controller.sha256,
        "kind": "ternary" if controller.is_ternary else "power-of-two weights",
        "nodes": len(controller.nodes),
        "links": controller.num_links,
        "packed": sources.sizes.packed[0].num_bytes,
        "steps": sum(episode.steps for episode in sources.episodes),
        "held_out": {"mean": mean, "std": std, "episodes": episodes} if known else None,
    }


def _charts(sources: Sources) -> list[Any]:
    history = sources.history or History()
    pareto = pareto_chart(history, sources.champion, sources.others)
    return [*history_charts(history), *([pareto] if pareto is not None else [])]


def _data_url(text: str) -> str:
    return "data:text/plain;base64," + base64.b64encode(text.encode()).decode("ascii")


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_PROVENANCE else text[:MAX_PROVENANCE] + "\n… and so on, in the champion file"
