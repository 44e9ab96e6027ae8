# SPDX-License-Identifier: MIT
"""The packaged data is found in each of the ways that bitneat is installed; built offline with the build backend itself."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from bitneat.native import runtime_dir, templates_dir

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ("bitneat", "codegen", "runtime_c", "pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md")
PAGE = ("page.css.j2", "page.html.j2", "page.js")
SHOW = (
    "import bitneat, pathlib\n"
    "from bitneat.native import runtime_dir, templates_dir\n"
    "print(pathlib.Path(bitneat.__file__).parent, templates_dir(), runtime_dir(), sep='\\n')\n"
)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources, so that nothing is built in the working tree."""
    copy = tmp_path_factory.mktemp("checkout")
    for part in SHIPPED:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, copy / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / part, copy / part)
    return copy


def run(code: str, *, folder: Path) -> list[str]:
    """Run Python where ``folder`` is looked at first, as if it were site-packages, even if bitneat is installed as well."""
    before = (
        "import site, sys\n"
        "installed = sys.path[:]\n"
        f"site.addsitedir({str(folder)!r})\n"
        "sys.path[:] = [path for path in sys.path if path not in installed] + installed\n"
    )
    program = before + code
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return subprocess.run(
        [sys.executable, "-P", "-c", program], check=True, capture_output=True, text=True, cwd=folder, env=environment
    ).stdout.splitlines()


def test_a_checkout_uses_its_own_files() -> None:
    assert templates_dir() == ROOT / "codegen" / "templates"
    assert runtime_dir() == ROOT / "runtime_c"


def test_a_wheel_carries_templates_and_runtime(checkout: Path, tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path / "dist")],
        check=True,
        cwd=checkout,
        capture_output=True,
    )
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    package, templates, runtime = run(SHOW, folder=site)
    assert package == str(site / "bitneat")
    assert templates == str(site / "bitneat" / "_data" / "templates")
    assert runtime == str(site / "bitneat" / "_data" / "runtime_c")
    for installed, original in ((templates, "codegen/templates"), (runtime, "runtime_c")):
        assert names(Path(installed)) == names(checkout / original)
    assets = Path("bitneat", "report", "page", "assets")
    assert names(site / assets) == names(checkout / assets) == {"chart.svg.j2", "graph.svg.j2", *PAGE}


def test_an_editable_install_uses_the_edited_template(checkout: Path, tmp_path: Path) -> None:
    build = f"from hatchling.build import build_editable; print(build_editable({str(tmp_path)!r}))"
    subprocess.run([sys.executable, "-c", build], check=True, cwd=checkout, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    (checkout / "codegen" / "templates" / "edited.j2").write_text("edited after the install")
    code = "from bitneat.native import templates_dir; print((templates_dir() / 'edited.j2').read_text())"
    assert run(code, folder=site) == ["edited after the install"]
    assert run(SHOW, folder=site)[1:] == [str(checkout / "codegen" / "templates"), str(checkout / "runtime_c")]


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
