# SPDX-License-Identifier: MIT
import random
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from bitneat.controller import Reference
from bitneat.native.compiler import CompilerError
from bitneat.verify import implementation as under_test
from bitneat.verify.cfile import CFile, CFileError
from bitneat.verify.child import REQUEST, STEPS
from bitneat.verify.implementation import HostC, ImplementationError
from tests.strategies import input_vectors
from tests.verify.champions import champion, plain_champion, written


def edited(code: CFile, old: str, new: str) -> CFile:
    assert old in code.source
    code.path.write_text(code.source.replace(old, new, 1))
    return CFile.read(code.path)


@pytest.mark.parametrize(("style", "entry"), [("unrolled", "step"), ("table", "step"), ("table", "run")])
@pytest.mark.parametrize("recurrent", [False, True])
def test_the_c_file_computes_what_the_reference_does(style: str, entry: str, recurrent: bool, tmp_path: Path) -> None:
    whose = champion(seed=3, recurrent=recurrent)
    vectors = input_vectors(whose.controller, random.Random(2), 100)
    with HostC(written(whose, tmp_path, style), entry) as code:  # type: ignore[arg-type]
        code.reset()
        one_by_one = [code.step(np.array(row, dtype=np.int16)).tolist() for row in vectors]
        code.reset()
        at_once = code.run(np.array(vectors, dtype=np.int16)).tolist()
    assert one_by_one == at_once == Reference(whose.controller).run(vectors)


def test_the_file_itself_is_what_is_compiled(tmp_path: Path) -> None:
    code = edited(written(plain_champion(), tmp_path), "action[0] = legs_signal(n0);", "action[0] = 99;")
    with HostC(code) as running:
        assert running.step(np.zeros(3, dtype=np.int16)).tolist() == [99]


def test_an_output_that_is_never_written_shows(tmp_path: Path) -> None:
    code = edited(written(plain_champion(), tmp_path), "action[0] = legs_signal(n0);", "(void)action; (void)n0;")
    with HostC(code) as running:
        assert running.step(np.zeros(3, dtype=np.int16)).tolist() == [-32768]


def test_a_state_that_is_not_reset_shows(tmp_path: Path) -> None:
    whose = champion(seed=3, recurrent=True)
    code = written(whose, tmp_path)
    assert code.num_state
    source = code.source
    for i in range(code.num_state):
        source = source.replace(f"    state->delayed[{i}] = 0;\n", "    (void)state;\n")
    code.path.write_text(source)
    vectors = input_vectors(whose.controller, random.Random(2), 30)
    with HostC(CFile.read(code.path)) as running:
        running.reset()
        assert running.run(np.array(vectors, dtype=np.int16)).tolist() != Reference(whose.controller).run(vectors)


def test_a_choice_among_actions_is_the_codes_own(tmp_path: Path) -> None:
    whose = champion("CartPole-v1")
    with HostC(written(whose, tmp_path)) as running:
        rows = np.array([[1, 2], [2, 1], [3, 3], [-32767, 32767]], dtype=np.int16)
        assert running.decisions(rows).reshape(-1).tolist() == [1, 0, 0, 1]
        assert running.decide(rows[0]) == 1
    with HostC(written(plain_champion(), tmp_path)) as running:
        assert running.decide(np.zeros(1, dtype=np.int16)) is None


def test_a_crash_is_a_finding_and_not_the_end(tmp_path: Path) -> None:
    code = edited(
        written(plain_champion(), tmp_path), "action[0] = legs_signal(n0);", "*(volatile int *)0 = 1; (void)n0;"
    )
    with HostC(code) as running, pytest.raises(ImplementationError, match=r"crashed \(SIG(SEGV|ILL|TRAP)\)"):
        running.step(np.zeros(3, dtype=np.int16))


def test_an_endless_loop_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(under_test, "TIME_LIMIT", 1)
    code = edited(
        written(plain_champion(), tmp_path), "    action[0]", "    for (volatile int i = 1; i != 0;) { }\n    action[0]"
    )
    began = time.monotonic()
    with HostC(code) as running, pytest.raises(ImplementationError, match="did not come back within 1 s"):
        running.step(np.zeros(3, dtype=np.int16))
    assert time.monotonic() - began < 15


def test_what_hangs_is_ended_when_it_is_no_longer_wanted(tmp_path: Path) -> None:
    code = edited(
        written(plain_champion(), tmp_path), "    action[0]", "    for (volatile int i = 1; i != 0;) { }\n    action[0]"
    )
    running = HostC(code)
    running._requests.write(REQUEST.pack(STEPS, 1) + bytes(6))
    running._requests.flush()
    running.close()
    assert running._process.returncode == -signal.SIGKILL
    assert running._requests.closed
    assert running._answers.closed


def test_what_ended_by_itself_is_said(tmp_path: Path) -> None:
    text = "action[0] = legs_signal(n0);"
    code = edited(written(plain_champion(), tmp_path), text, text + " extern void exit(int); exit(3);")
    with HostC(code) as running, pytest.raises(ImplementationError, match=r"^its process ended with status 3$"):
        running.step(np.zeros(3, dtype=np.int16))
    with HostC(code) as running:
        for _ in range(2):  # the second time there is no one to be asked any more
            with pytest.raises(ImplementationError, match="status 3"):
                running.step(np.zeros(3, dtype=np.int16))
        first = running._process
        running.restart()
        assert running._process.pid != first.pid
        with pytest.raises(ImplementationError, match="status 3"):
            running.step(np.zeros(3, dtype=np.int16))


def test_a_missing_function_is_one_clear_line(tmp_path: Path) -> None:
    code = written(plain_champion(), tmp_path)
    code.path.write_text(code.source.replace("legs_step(", "other_step("))
    code.header_path.write_text(code.header.replace("legs_step(", "other_step("))
    with pytest.raises(CFileError, match=r"legs\.c: does not load: .*legs_step"):
        HostC(CFile.read(code.path))


def test_a_file_that_does_not_compile_is_one_clear_line(tmp_path: Path) -> None:
    code = edited(written(plain_champion(), tmp_path), "action[0] =", "action[0] = nonsense +")
    with pytest.raises(CompilerError, match=r"legs\.c: .* failed: .*nonsense"):
        HostC(code)
