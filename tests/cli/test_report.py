# SPDX-License-Identifier: MIT
from __future__ import annotations

import hashlib
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from bitneat.champion import FloatChampion, load, save_json, save_pickle
from bitneat.cli.main import build_parser, main
from bitneat.network import FloatNetwork, FloatNode
from tests.report.page.pages import QUICK, TINY, data_of, write_page
from tests.verify.champions import champion, plain_champion

WALKER = TINY.with_name("walker.pkl")


def test_the_same_champion_gives_the_same_bytes_from_any_folder_and_file(tmp_path: Path) -> None:
    whose = champion("CartPole-v1", seed=2)
    pages = []
    for folder, save in ((tmp_path / "one", save_pickle), (tmp_path / "the other", save_json)):
        folder.mkdir()
        save(whose, folder / f"c{len(pages)}.file")
        pages.append(write_page(folder / f"c{len(pages)}.file", folder / "page.html", *QUICK, "--seeds", "4,9"))
    assert pages[0] == pages[1]
    assert str(tmp_path) not in pages[0]
    assert [episode["seed"] for episode in data_of(pages[0])["episodes"]] == [4, 9]


def test_the_page_needs_nothing_from_anywhere_and_allows_nothing(tmp_path: Path) -> None:
    save_pickle(plain_champion(), tmp_path / "c.pkl")
    arguments = ["--json", str(tmp_path / "r.json"), "--seeds", "3"]
    html = write_page(tmp_path / "c.pkl", tmp_path / "page.html", *QUICK, *arguments)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None
    assert policy[1].startswith("default-src &#39;none&#39;; script-src &#39;sha256-")
    assert "unsafe-inline" not in policy[1]
    assert "&#39;unsafe-eval" not in policy[1]
    assert "://" not in html
    assert re.findall(r'(?:src|href)="(?!#|data:)', html) == []
    assert len(html) < 3_000_000
    summary = json.loads((tmp_path / "r.json").read_text())
    assert summary["sha256"] == hashlib.sha256(html.encode()).hexdigest()
    assert summary["verdict"] == "pass"
    assert summary["bytes"] == len(html.encode())


def test_the_c_on_the_page_is_what_codegen_writes(tmp_path: Path) -> None:
    whose = plain_champion()
    save_pickle(whose, tmp_path / "c.pkl")
    summary = tmp_path / "r.json"
    html = write_page(tmp_path / "c.pkl", tmp_path / "page.html", *QUICK, "--json", str(summary))
    command = re.search(r"bitneat codegen champion\.pkl -o (\w+\.c)", html)
    assert command is not None
    assert main(["codegen", str(tmp_path / "c.pkl"), "-o", str(tmp_path / command[1])]) == 0
    digest = hashlib.sha256((tmp_path / command[1]).read_bytes()).hexdigest()
    assert digest == json.loads(summary.read_text())["c_sha256"]
    assert digest in html
    assert "Not shown: this page was made from a champion file alone" in html


def test_other_champions_stand_in_the_chart_of_reward_and_size(tmp_path: Path) -> None:
    verified = tmp_path / "v.json"
    controller = {"sha256": load(TINY).controller.sha256}
    verified.write_text(json.dumps({"verdict": "pass", "controller": controller, "targets": []}))
    arguments = ["--verify", str(verified), "--targets", "host-table", "--seeds", "127", "--compare", str(WALKER)]
    html = write_page(TINY, tmp_path / "page.html", *arguments)
    assert "this champion: 32 bytes, 311.7" in html
    assert "walker: 44 bytes, 332.0" in html


def test_a_failed_verification_is_shown_and_the_exit_status_says_so(tmp_path: Path) -> None:
    whose = plain_champion()
    save_pickle(whose, tmp_path / "c.pkl")
    controller = {"sha256": whose.controller.sha256}
    report = {"verdict": "fail", "controller": controller, "failures": ["host: <output> 0 is 1"], "targets": [1, {}]}
    (tmp_path / "v.json").write_text(json.dumps(report))
    (tmp_path / "p.json").write_text(
        json.dumps({"verdict": "pass", "controller": controller, "pairs": [], "claims": [{"a": "<b>"}]})
    )
    arguments = ["--targets", "host-table", "--verify", str(tmp_path / "v.json"), "--prove", str(tmp_path / "p.json")]
    html = write_page(tmp_path / "c.pkl", tmp_path / "page.html", *arguments, "--seeds", "1", status=1)
    assert "host: &lt;output&gt; 0 is 1" in html
    assert "verify: fail" in html
    assert "proof: pass" in html
    assert "<td>claims[0].a</td><td>&lt;b&gt;</td>" in html


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "not the JSON of a report"),
        ('{"verdict": "maybe"}', "expected a report with a verdict, pass or fail"),
        (
            '{"verdict": "pass", "controller": {"sha256": "abc"}, "targets": []}',
            "is of controller abc, the champion's is ",
        ),
        (
            '{"verdict": "pass", "controller": {"sha256": "abc"}, "command": "verify"}',
            "is no report of verify or prove",
        ),
    ],
)
def test_a_verdict_on_something_else_is_refused(
    content: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_pickle(plain_champion(), tmp_path / "c.pkl")
    for option, key in (("--verify", "targets"), ("--prove", "pairs")):
        (tmp_path / "v.json").write_text(content.replace("targets", key))
        arguments = [str(tmp_path / "c.pkl"), "-o", str(tmp_path / "p.html"), option, str(tmp_path / "v.json")]
        assert main(["report", *arguments]) == 2
        err = capsys.readouterr().err
        assert err.startswith(f"bitneat: {tmp_path / 'v.json'}: {message}")
        assert err.count("\n") == 1


def test_a_report_of_verify_is_no_proof_and_the_other_way_round(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whose = plain_champion()
    save_pickle(whose, tmp_path / "c.pkl")
    bare = {"verdict": "pass", "controller": {"sha256": whose.controller.sha256}}
    verified, proved = bare | {"targets": [], "c_sha256": "0"}, bare | {"pairs": [], "tools": {}}
    arguments = ["report", str(tmp_path / "c.pkl"), "-o", str(tmp_path / "page.html")]
    for option, report, found in (
        ("prove", verified, "was written by verify --json"),
        ("prove", {"command": "verify", **verified}, "was written by verify --json"),
        ("verify", proved, "was written by prove --json"),
        ("verify", {"command": "prove", **proved}, "was written by prove --json"),
        ("verify", bare, "is no report of verify or prove"),
        ("prove", bare, "is no report of verify or prove"),
    ):
        (tmp_path / "v.json").write_text(json.dumps(report))
        assert main([*arguments, f"--{option}", str(tmp_path / "v.json")]) == 2
        message = f"bitneat: {tmp_path / 'v.json'}: {found}, expected one that {option} --json wrote\n"
        assert capsys.readouterr().err == message
    assert not (tmp_path / "page.html").exists()


def test_what_cannot_have_a_page_is_said_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whose = plain_champion()
    network = FloatNetwork(3, (FloatNode(((0, 0.5),)),), (3,))
    save_pickle(FloatChampion(network, whose.action, whose.environment), tmp_path / "float.pkl")
    save_pickle(replace(whose, environment=None), tmp_path / "homeless.pkl")
    (tmp_path / "empty").mkdir()
    for name, message in (
        ("float.pkl", "float.pkl: holds a float network, expected an integer controller"),
        ("homeless.pkl", "champion: names no environment"),
        ("missing.pkl", "missing.pkl: cannot read: No such file"),
        ("empty", "champion.pkl: cannot read: No such file"),
    ):
        assert main(["report", str(tmp_path / name), "-o", str(tmp_path / "p.html")]) == 2
        err = capsys.readouterr().err
        assert message in err
        assert err.count("\n") == 1
    assert not (tmp_path / "p.html").exists()


@pytest.mark.parametrize("seeds", ["x", "-1", "1,,2", ",".join(map(str, range(13))), str(2**31)])
def test_seeds_are_checked(seeds: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(TINY), "-o", str(tmp_path / "p.html"), f"--seeds={seeds}"]) == 2
    assert "whole numbers" in capsys.readouterr().err


def test_seeds_that_are_given_one_by_one_are_all_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parser = build_parser(("report",))
    line = ["report", "c.pkl", "-o", "p.html", "--seeds", "1", "--seeds", "2,1", "--seeds", "0"]
    assert parser.parse_args(line).seeds == (1, 2, 0)
    many = [word for number in range(13) for word in ("--seeds", str(number))]
    assert main(["report", str(TINY), "-o", str(tmp_path / "p.html"), *many]) == 2
    assert "argument --seeds: expected 1 to 12 whole numbers in all, got 13" in capsys.readouterr().err


def test_a_folder_is_no_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(TINY), "-o", str(tmp_path)]) == 2
    assert "is a folder, expected the name of an HTML file" in capsys.readouterr().err
    shutil.rmtree(tmp_path)
