# SPDX-License-Identifier: MIT
"""Films and strips: what is in the files, against episodes that the tests run and draw themselves."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import gymnasium
import imageio_ffmpeg
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image, ImageSequence

import tests.sim.strange  # noqa: F401 - registers environments
from bitneat.champion import Champion, EnvironmentSpec, FloatChampion, load, save_pickle
from bitneat.cli.main import main
from bitneat.controller import Controller, DiscreteAction, Encoder, Input, Link, Node, Reference, Signal
from bitneat.network import FloatNetwork, FloatNode
from bitneat.runtime import RuntimeController
from bitneat.sim.environment import EpisodeRunner, inspect

ROOT = Path(__file__).resolve().parents[2]
TINY = ROOT / "examples" / "champions" / "tiny.pkl"
POLE = EnvironmentSpec("CartPole-v1")
CONTROLLER = Controller((Input(),) * 4, (Node((Link(2, 0, 0, -1),)), Node((Link(2), Link(3)))), (Signal(4), Signal(5)))
ACTION = DiscreteAction(2)


@pytest.fixture
def pole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Champion:
    monkeypatch.chdir(tmp_path)
    champion = Champion(CONTROLLER, ACTION, POLE, {"generation": 7, "max_steps": 500})
    save_pickle(champion, "champion.pkl")
    return champion


def pictures(seed: int) -> list[npt.NDArray[Any]]:
    """Each step's picture, and before them the one after reset, by Gymnasium and the reference evaluator alone."""
    environment = gymnasium.make("CartPole-v1", render_mode="rgb_array")
    reference, encoder = Reference(CONTROLLER), Encoder(CONTROLLER)
    observation, _ = environment.reset(seed=seed)
    taken = [np.asarray(environment.render())]
    over = False
    while not over:
        outputs = reference.step([int(v) for v in encoder(observation)])
        observation, _, terminated, truncated, _ = environment.step(int(np.argmax(outputs)))
        taken.append(np.asarray(environment.render()))
        over = terminated or truncated
    environment.close()
    return taken


def test_a_gif_holds_the_pictures_of_the_episode_and_loops(pole: Champion) -> None:
    assert (
        main(["render", "-o", "pole.gif", "--every", "4", "--json", "out.json", "--seed", "3", "--width", "300"]) == 0
    )
    expected = pictures(3)
    steps = len(expected) - 1
    summary = json.loads(Path("out.json").read_text())
    assert summary["steps"] == steps
    assert summary["reward"] == steps
    assert summary["bytes"] == Path("pole.gif").stat().st_size
    with Image.open("pole.gif") as film:
        assert film.size == (300, 200)
        assert film.info["loop"] == 0
        wanted = sorted({*range(0, steps + 1, 4), steps})
        shown = [np.asarray(frame.convert("RGB"), np.int16) for frame in ImageSequence.Iterator(film)]
        film.seek(0)
        assert film.info["duration"] == 80  # four steps of 1/50 s
    assert len(shown) == len(wanted) == summary["pictures"]
    for image, step in zip(shown, wanted, strict=True):
        small = Image.fromarray(expected[step]).resize((300, 200), Image.Resampling.LANCZOS)
        difference = np.abs(image - np.asarray(small, np.int16)).max(axis=2)
        assert np.mean(difference[100:] > 60) < 0.01, step  # below the panel, but for the palette
    assert (shown[0][:60, :110] != shown[-1][:60, :110]).any()  # the panel counts


def test_a_strip_shows_the_very_pixels_evenly_spaced(pole: Champion) -> None:
    assert main(["render", "-o", "pole.png", "--frames", "3", "--seed", "1", "--width", "600"]) == 0
    expected = pictures(1)
    with Image.open("pole.png") as page:
        assert page.info["Title"] == "CartPole-v1, seed 1"
        pixels = np.asarray(page)
    last = len(expected) - 1
    for place, step in enumerate((0, round(last / 2), last)):
        left = place * 604
        assert (pixels[:400, left : left + 600] == expected[step]).all(), step
        assert (pixels[400:, left : left + 600] < 100).any(), "a caption"


def test_an_mp4_has_the_frames_the_size_and_the_rate(pole: Champion) -> None:
    assert main(["render", "-o", "pole.mp4", "--steps", "20", "--width", "201", "--fps", "10"]) == 0
    reader = imageio_ffmpeg.read_frames("pole.mp4")
    meta = next(reader)
    frames = [np.frombuffer(frame, np.uint8).reshape(134, 200, 3) for frame in reader]
    assert (meta["size"], meta["fps"], meta["codec"]) == ((200, 134), 10, "h264")
    assert len(frames) == 21
    small = Image.fromarray(pictures(0)[10]).resize((201, 134), Image.Resampling.LANCZOS).crop((0, 0, 200, 134))
    assert np.mean(np.abs(frames[10][70:].astype(int) - np.asarray(small).astype(int)[70:])) < 6


@pytest.mark.parametrize("name", ["pole.gif", "pole.mp4"])
def test_a_picture_stays_for_no_longer_than_a_film_can_say(pole: Champion, name: str) -> None:
    assert main(["render", "-o", name, "--steps", "3", "--every", "100000", "--width", "64", "--json", "p.json"]) == 0
    assert json.loads(Path("p.json").read_text())["fps"] == 0.01
    assert Path(name).stat().st_size > 0


@pytest.mark.parametrize("suffix", ["gif", "mp4", "png"])
def test_the_same_episode_is_the_same_file(pole: Champion, suffix: str) -> None:
    contents = set()
    for number in range(2):
        name = f"{number}.{suffix}"
        assert main(["render", "-o", name, "--steps", "12", "--width", "120"]) == 0
        contents.add(Path(name).read_bytes())
    assert len(contents) == 1


def test_a_walkers_reward_is_the_official_one_and_its_pictures_are_few_bytes(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    assert main(["render", str(TINY), "-o", str(tmp_path / "w.gif"), "--steps", "90", "--json", str(out)]) == 0
    champion = load(TINY)
    assert champion.environment is not None
    running = RuntimeController(champion.controller)
    episode = EpisodeRunner(champion.environment, champion.controller, champion.action, running)(0, 90)
    summary = json.loads(out.read_text())
    assert (summary["reward"], summary["steps"]) == (episode.reward, 90)
    assert summary["pictures"] == 31
    assert summary["bytes"] / 31 < 3e6 / 540  # the longest walk has so many


def test_hardcore_and_float_champions(tmp_path: Path) -> None:
    spec = EnvironmentSpec("BipedalWalker-v3")
    info = inspect(spec)
    network = FloatNetwork(24, (FloatNode(((8, 1.0),)),), (24, 24, 24, 24))
    path = tmp_path / "float.pkl"
    save_pickle(FloatChampion(network, info.action, spec, {}), path)
    rewards = []
    for more in ([], ["--hardcore"]):
        out = tmp_path / "out.json"
        film = str(tmp_path / "f.gif")
        assert main(["render", str(path), "-o", film, "--steps", "60", "--json", str(out), *more]) == 0
        summary = json.loads(out.read_text())
        rewards.append(summary["reward"])
    assert summary["environment"] == "BipedalWalkerHardcore-v3"
    observed = EpisodeRunner(spec, network, info.action, network)(0, 60)
    assert rewards[0] == observed.reward


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "a.avi"], "bitneat: a.avi: expected a name that ends in .gif, .mp4 or .png"),
        (["-o", "none/a.gif"], "bitneat: none/a.gif: cannot write: No such file or directory"),
        (["-o", "a.gif", "--fps", "0"], "--fps 0: expected a number in 0.01..1000"),
        (["-o", "a.gif", "--fps", "0.001"], "--fps 0.001: expected a number in 0.01..1000"),
        (["-o", "a.mp4", "--fps", "1e-300"], "--fps 1e-300: expected a number in 0.01..1000"),
        (["-o", "a.gif", "--fps", "nan"], "--fps nan: expected a number in 0.01..1000"),
        (["-o", "a.gif", "--frames", "3"], "--frames: not of a .gif"),
        (["-o", "a.png", "--every", "3"], "--every: not of a .png"),
        (["-o", "a.gif", "--width", "3"], "--width"),
        (["-o", "a.gif", "--hardcore"], "champion.pkl: does not fit BipedalWalkerHardcore-v3"),
        (["none.pkl", "-o", "a.gif"], "none.pkl: cannot read"),
        (["homeless.pkl", "-o", "a.gif"], "homeless.pkl: names no environment to run in"),
        (
            ["matrix.pkl", "-o", "a.gif"],
            "environment bitneat/Matrix-v0: draws no pictures: it lacks the render mode rgb_array",
        ),
    ],
)
def test_what_cannot_be_is_one_line(
    pole: Champion, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    save_pickle(Champion(CONTROLLER, ACTION, None, {}), "homeless.pkl")
    spec = EnvironmentSpec("bitneat/Matrix-v0")
    info = inspect(spec)
    nodes = tuple(Node((Link(0),)) for _ in range(info.action.num_outputs))
    outputs = tuple(Signal(info.num_inputs + i) for i in range(len(nodes)))
    matrix = Controller((Input(),) * info.num_inputs, nodes, outputs)
    save_pickle(Champion(matrix, info.action, spec, {"max_steps": 5}), "matrix.pkl")
    assert main(["render", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("module", "name", "film"),
    [("PIL", "Pillow", "a.gif"), ("imageio_ffmpeg", "imageio-ffmpeg", "a.mp4")],
)
def test_a_missing_package_is_named_before_the_episode(
    pole: Champion,
    module: str,
    name: str,
    film: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["render", "-o", film]) == 2
    assert capsys.readouterr().err == f"bitneat: render: {name} is not installed; pip install 'bitneat[render]'\n"


def test_without_pygame_it_says_what_to_install(
    pole: Champion, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert main(["render", "-o", "a.gif"]) == 2
    assert capsys.readouterr().err == "bitneat: render: pygame is not installed; pip install 'bitneat[render]'\n"
