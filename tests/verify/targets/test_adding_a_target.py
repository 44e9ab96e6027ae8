# SPDX-License-Identifier: MIT
import re
from pathlib import Path

import pytest

from bitneat.verify.check import Settings, verify
from bitneat.verify.targets import TARGETS, select
from tests.verify.champions import champion, written

PAGE = Path(__file__).resolve().parents[3] / "docs" / "adding-a-target.md"


def test_the_target_on_the_page_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len([line for line in example.splitlines() if line]) <= 15
    monkeypatch.setitem(TARGETS, "cortex-m7", None)  # type: ignore[arg-type]  # removed again afterwards
    exec(example, {})
    whose = champion(seed=3)
    report = verify(whose, written(whose, tmp_path), select(["cortex-m7"]), Settings(1, max_steps=5))
    assert report.failures == ()
    assert [(entry.name, entry.mismatches) for entry in report.targets] == [("cortex-m7", 0)] * 2
    assert report.targets[0].timing is not None
    assert report.targets[0].timing.step.claim == "data-independent trace"
