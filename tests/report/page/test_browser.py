# SPDX-License-Identifier: MIT
"""The page in a real Chromium, opened from the disk; each worker that runs some of these has one browser."""

from __future__ import annotations

import base64
import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from bitneat.champion import Champion, load, save_pickle
from bitneat.controller import Controller, Link
from tests.report.page.pages import HOSTILE, QUICK, TINY, Truth, data_of, spread_steps, truth, with_data, write_page
from tests.verify.champions import champion as random_champion

ARGUMENTS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)


FIRST, SECOND = 361, 127
"""Seeds with which the walker soon falls, so that the tests are short."""
HISTORY = "generation,best,selection,best_links\n0,-1250,-1200.25,3\n1,,-990.5,4\n2,-800,-900,4\n"


@dataclass(frozen=True)
class Made:
    """A page, its champion, and what is true of its episodes."""

    path: Path
    html: str
    champion: Champion
    episodes: tuple[Truth, ...]

    @property
    def steps(self) -> int:
        return sum(episode.steps for episode in self.episodes)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    chromium = shutil.which("chromium")
    assert chromium is not None, "chromium is missing; tools/install-debian-tools.sh installs it"
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=chromium, args=list(ARGUMENTS))
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("walker")
    champion = load(TINY)
    assert isinstance(champion.provenance, dict)
    champion = replace(champion, provenance={**champion.provenance, HOSTILE: HOSTILE, "tool": HOSTILE})
    save_pickle(champion, folder / "champion.pkl")
    controller = {"sha256": champion.controller.sha256}
    verify = {"verdict": "pass", "controller": controller, "environment": HOSTILE, "targets": []}
    (folder / "verify.json").write_text(json.dumps(verify))
    arguments = ["--targets", "host-table", "--verify", str(folder / "verify.json"), "--seeds", f"{FIRST},{SECOND}"]
    html = write_page(folder / "champion.pkl", folder / "report.html", *arguments)
    return Made(folder / "report.html", html, champion, (truth(champion, FIRST), truth(champion, SECOND)))


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """In a run's folder; with links from the step before, so that its C keeps state."""
    folder = tmp_path_factory.mktemp("pendulum")
    champion = random_champion("Pendulum-v1", seed=2, recurrent=True)  # one that a forgotten reset changes
    save_pickle(champion, folder / "champion.pkl")
    (folder / "history.csv").write_text(HISTORY)
    html = write_page(folder, folder / "report.html", *QUICK, "--seeds", "5,6")
    return Made(folder / "report.html", html, champion, (truth(champion, 5), truth(champion, 6)))


@contextmanager
def opened(browser: Browser, path: Path, *, calm: bool = True, script: str = "", **options: Any) -> Iterator[Page]:
    """The page when it has computed everything; nothing but its own file may be asked for, nothing may go wrong."""
    context = browser.new_context(reduced_motion="reduce" if calm else "no-preference", **options)
    page = context.new_page()
    trouble: list[str] = []
    page.on("console", lambda message: trouble.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on("request", lambda request: trouble.append(request.url) if request.url != path.as_uri() else None)
    if script:
        page.add_init_script(script)
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready]")
    yield page
    assert trouble == []
    context.close()


def seek(page: Page, step: int) -> None:
    page.locator("#scrub").fill(str(step))


def wait_until(page: Page, condition: str) -> None:
    """Ask again and again from outside: the page's policy forbids to evaluate text inside of it."""
    deadline = time.monotonic() + 10
    while not page.evaluate(condition):
        assert time.monotonic() < deadline, f"never: {condition}"
        page.wait_for_timeout(20)


def verdict(page: Page) -> tuple[str, str]:
    return page.get_attribute("#parity", "data-verdict") or "", page.inner_text("#parity-text")


def shown(page: Page) -> dict[str, str]:
    """The value in each box of the drawing."""
    values: dict[str, str] = page.evaluate(
        "Object.fromEntries([...document.querySelectorAll('.box')].map("
        "box => [box.dataset.key, box.querySelector('.value').textContent.replace('−', '-')]))"
    )
    return values


def test_the_page_says_how_many_steps_its_own_webassembly_computed_as_recorded(
    browser: Browser, walker: Made, pendulum: Made
) -> None:
    for made in (walker, pendulum):
        with opened(browser, made.path) as page:
            steps = f"{made.steps:,}"
            assert verdict(page) == ("pass", f"{steps} of {steps} steps, every output bit")
            assert page.inner_text("#parity-chip") == page.inner_text("#parity-badge") == "bit-exact"


def keys(controller: Controller) -> dict[str, int]:
    num_inputs = len(controller.inputs)
    read = {link.source for node in controller.nodes for link in node.links if link.source < num_inputs}
    inputs = {f"x{signal}": signal for signal in read}
    return inputs | {f"n{index}": num_inputs + index for index in range(len(controller.nodes))}


@pytest.mark.parametrize("which", ["walker", "pendulum"])
def test_the_drawing_shows_the_signals_of_the_reference(
    browser: Browser, which: str, request: pytest.FixtureRequest
) -> None:
    made: Made = request.getfixturevalue(which)
    signals = keys(made.champion.controller.canonical)
    with opened(browser, made.path) as page:
        for number, episode in enumerate(made.episodes):
            page.select_option("#episode", str(number))
            for step in spread_steps(episode.steps):
                seek(page, step)
                expected = {key: str(episode.signals[step, signal]) for key, signal in signals.items()}
                expected |= {f"y{index}": str(value) for index, value in enumerate(episode.outputs[step])}
                assert shown(page) == expected, f"episode {number}, step {step}"


def test_choosing_a_node_shows_each_term_of_its_sum(browser: Browser, pendulum: Made) -> None:
    controller = pendulum.champion.controller.canonical
    episode = pendulum.episodes[0]
    first, step = len(controller.inputs), 23

    def value(link: Link) -> int:
        return link.sign * int(episode.signals[step - link.delay, link.source]) << link.shift

    delayed = 0
    with opened(browser, pendulum.path) as page:
        seek(page, step)
        for index, node in enumerate(controller.nodes):
            page.locator(f'.box[data-key="n{index}"]').focus()
            terms = [int(text.replace("−", "-")) for text in page.locator("#formula .term b").all_inner_texts()]
            bias = [node.bias] if node.bias or not node.links else []
            assert terms == [*(value(link) for link in node.links), *bias]
            result = page.inner_text("#formula .result").replace("−", "-")
            assert result.startswith(f"acc = {sum(terms)}")
            assert result.endswith(f"n{index} = {episode.signals[step, first + index]}")
            delayed += sum(link.delay for link in node.links)
            primes = sum("′" in text for text in page.locator("#formula .term span").all_inner_texts())
            assert primes == sum(link.delay for link in node.links)
    assert delayed


def picture(page: Page) -> str:
    return str(page.evaluate("document.getElementById('walk').toDataURL()"))


def test_play_moves_the_walker_and_pause_stops_it(browser: Browser, walker: Made) -> None:
    with opened(browser, walker.path) as page:
        before = picture(page)
        assert page.get_attribute("#walk", "data-step") == "0"
        page.click("#play")
        wait_until(page, "Number(document.getElementById('walk').dataset.step) > 20")
        page.click("#play")
        step = int(page.get_attribute("#walk", "data-step") or 0)
        assert picture(page) != before
        assert page.inner_text("#play") == "Play"
        page.wait_for_timeout(120)
        assert page.get_attribute("#walk", "data-step") == str(step)


def test_it_walks_by_itself_unless_the_reader_prefers_less_motion(browser: Browser, walker: Made) -> None:
    moving = "Number(document.getElementById('walk').dataset.step) > 3"
    with opened(browser, walker.path, calm=False) as page:
        wait_until(page, moving)
    with opened(browser, walker.path) as page:
        page.wait_for_timeout(200)
        assert not page.evaluate(moving)


def test_the_keyboard_alone_is_enough(browser: Browser, walker: Made) -> None:
    with opened(browser, walker.path) as page:

        def pressed(key: str) -> int:
            page.keyboard.press(key)
            return int(page.get_attribute("#walk", "data-step") or -1)

        assert [pressed(key) for key in ("ArrowRight", "Shift+ArrowRight", "ArrowLeft")] == [1, 11, 10]
        assert [pressed(key) for key in ("End", "Home")] == [walker.episodes[0].steps - 1, 0]
        page.keyboard.press("Space")
        assert page.inner_text("#play") == "Pause"
        page.keyboard.press("Space")
        # Everything that can be operated has a name.
        names = page.evaluate(
            "[...document.querySelectorAll('button, input, select, canvas, [tabindex]')].filter("
            "e => !(e.ariaLabel || e.textContent.trim() || e.labels?.length)).map(e => e.outerHTML)"
        )
        assert names == []


def replaced(made: Made, tmp_path: Path, change: Any) -> Path:
    data = data_of(made.html)
    change(data)
    path = tmp_path / "changed.html"
    path.write_text(with_data(made.html, data), encoding="utf-8")
    return path


def changed(text: str, offset: int, byte: int) -> str:
    content = bytearray(base64.b64decode(text))
    content[offset] = byte
    return base64.b64encode(content).decode()


def test_one_changed_byte_of_the_recorded_outputs_is_named(browser: Browser, walker: Made, tmp_path: Path) -> None:
    step, output = 100, 2
    right = int(walker.episodes[1].outputs[step, output])

    def change(data: Any) -> None:
        episode = data["episodes"][1]
        offset = 2 * (4 * step + output)
        low = base64.b64decode(episode["outputs"])[offset]
        episode["outputs"] = changed(episode["outputs"], offset, low ^ 1)

    with opened(browser, replaced(walker, tmp_path, change)) as page:
        state, text = verdict(page)
        assert state == "fail"
        assert text.startswith(f"{walker.steps - 1:,} of {walker.steps:,} steps equal")
        assert f"seed {SECOND}, step {step}, hip 2: {right} instead of {right ^ 1}".replace("-", "−") == text.split(
            "First difference: "
        )[1].replace("-", "−")
        assert page.inner_text("#parity-chip") == "NOT bit-exact"


@pytest.mark.parametrize("module", ["step", "run"])
def test_one_changed_byte_of_either_module_turns_the_verdict_red(
    browser: Browser, pendulum: Made, tmp_path: Path, module: str
) -> None:
    from bitneat.verify.wasm import I32_ADD, I32_SUB, read_wasm

    content = base64.b64decode(data_of(pendulum.html)["modules"][module]["wasm"])
    wasm = read_wasm(content)
    index = wasm.exports[data_of(pendulum.html)["modules"][module]["function"]]
    additions = [one.offset for one in wasm.functions[index - wasm.first_function] if one.code == I32_ADD]

    def change(data: Any) -> None:
        part = data["modules"][module]
        part["wasm"] = changed(part["wasm"], additions[len(additions) // 2], I32_SUB)

    with opened(browser, replaced(pendulum, tmp_path, change)) as page:
        assert verdict(page)[0] == "fail"


def test_a_module_that_does_not_load_is_a_failure(browser: Browser, pendulum: Made, tmp_path: Path) -> None:
    def change(data: Any) -> None:
        data["modules"]["step"]["wasm"] = changed(data["modules"]["step"]["wasm"], 8, 0xFF)

    with opened(browser, replaced(pendulum, tmp_path, change)) as page:
        state, text = verdict(page)
        assert state == "fail"
        assert text.startswith("The module does not run: ")


def test_the_reader_can_plant_faults_and_put_them_right(browser: Browser, walker: Made) -> None:
    with opened(browser, walker.path) as page:
        states = []
        for offset in data_of(walker.html)["modules"]["step"]["additions"][:4]:
            page.click("#fault")
            wait_until(page, f"document.getElementById('fault-text').textContent.includes('at byte {offset} of')")
            states.append(verdict(page)[0])
        assert "fail" in states
        page.click("#repair")
        wait_until(page, "document.getElementById('parity').dataset.verdict === 'pass'")


def test_without_webassembly_it_says_so_and_shows_what_was_recorded(browser: Browser, walker: Made) -> None:
    with opened(browser, walker.path, script="delete window.WebAssembly") as page:
        assert verdict(page) == ("unavailable", "This browser has no WebAssembly, so nothing was computed here.")
        seek(page, 50)
        values = shown(page)
        assert values["n0"] == "?"
        assert [values[f"y{index}"] for index in range(4)] == [str(y) for y in walker.episodes[0].outputs[50]]


def test_where_webassembly_is_forbidden_it_says_so(browser: Browser, pendulum: Made, tmp_path: Path) -> None:
    path = tmp_path / "forbidden.html"
    path.write_text(pendulum.html.replace(" &#39;wasm-unsafe-eval&#39;", ""), encoding="utf-8")
    page = browser.new_page(reduced_motion="reduce")
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready]")
    text = "This browser forbids WebAssembly in this page, so nothing was computed here."
    assert verdict(page) == ("unavailable", text)
    page.close()


def test_text_from_the_champion_stays_text(browser: Browser, walker: Made) -> None:
    with opened(browser, walker.path) as page:
        assert page.evaluate("window.planted") is None
        assert HOSTILE in page.inner_text("section[aria-labelledby=origin-title]")


_OVERFLOW = "document.documentElement.scrollWidth - window.innerWidth"
_CONTRASTS = """() => {
  const parse = (text) => (text.match(/[\\d.]+/g) || []).map(Number);
  const over = ([r, g, b, a = 1], below) => [r, g, b].map((c, i) => c * a + below[i] * (1 - a));
  const light = (rgb) => {
    const [r, g, b] = rgb.map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (element) => {
    if (!element) return [255, 255, 255];
    const colour = parse(getComputedStyle(element).backgroundColor);
    return colour.length === 4 && colour[3] === 0 ? behind(element.parentElement) : over(colour, behind(element.parentElement));
  };
  const found = [];
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (!own || !element.getClientRects().length || ["SCRIPT", "STYLE", "OPTION", "title"].includes(element.tagName)) continue;
    const style = getComputedStyle(element);
    const svg = element instanceof SVGElement;
    const ground = behind(element);
    const [high, low] = [light(over(parse(svg ? style.fill : style.color), ground)), light(ground)].sort((a, b) => b - a);
    found.push([(high + 0.05) / (low + 0.05), element.tagName, element.textContent.slice(0, 40)]);
  }
  return found.sort((a, b) => a[0] - b[0]);
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1440])
def test_it_fits_the_window_and_its_text_can_be_read(browser: Browser, walker: Made, scheme: str, width: int) -> None:
    with opened(browser, walker.path, color_scheme=scheme, viewport={"width": width, "height": 900}) as page:
        assert page.evaluate(_OVERFLOW) <= 0
        contrasts = page.evaluate(_CONTRASTS)
        assert len(contrasts) > 100
        assert contrasts[0][0] >= 4.5, contrasts[:3]
        dark = sum(
            int(part) for part in page.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g)")
        )
        assert (dark < 128) == (scheme == "dark")


def test_the_theme_can_be_chosen_against_the_systems(browser: Browser, walker: Made) -> None:
    ground = "getComputedStyle(document.body).backgroundColor"
    with opened(browser, walker.path, color_scheme="dark") as page:
        dark, drawn = page.evaluate(ground), picture(page)
        page.click("#theme")
        assert page.evaluate(ground) != dark
        assert picture(page) != drawn
        page.click("#theme")
        assert page.evaluate(ground) == dark


def test_a_chart_is_read_out_where_the_pointer_is(browser: Browser, pendulum: Made) -> None:
    with opened(browser, pendulum.path) as page:
        svg = page.locator('[data-chart="fitness"] svg')
        svg.scroll_into_view_if_needed()
        box = svg.bounding_box()
        assert box is not None
        for part, text in ((0.09, "generation 0 · best of the generation: −1,250"), (0.97, "generation 2 · best of")):
            page.mouse.move(box["x"] + box["width"] * part, box["y"] + box["height"] / 2)
            assert page.inner_text('[data-chart="fitness"] .readout').startswith(text)
        svg.focus()
        page.keyboard.press("ArrowLeft")
        readout = "generation 1 · best of the generation: – · champion so far, selection seeds: −990.5"
        assert page.inner_text('[data-chart="fitness"] .readout') == readout
