# SPDX-License-Identifier: MIT
import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bitneat import files
from bitneat.errors import BitneatError
from bitneat.files import (
    FileError,
    make_folder,
    read_capped,
    refuse_links,
    remove_leftovers,
    sole_user,
    write_atomic,
    write_json,
)


def test_a_written_file_holds_the_content_and_nothing_else_is_left(tmp_path: Path) -> None:
    write_atomic(tmp_path / "a.bin", b"\x00\xff")
    assert (tmp_path / "a.bin").read_bytes() == b"\x00\xff"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_a_file_that_was_there_is_replaced_and_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text("old")
    path.chmod(0o640)
    write_atomic(path, b"new")
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_new_file_obeys_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_atomic(tmp_path / "a", b"")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


def test_a_link_is_followed_and_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_atomic(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_bytes() == b"new"


def test_a_device_is_written_straight() -> None:
    write_atomic("/dev/null", b"gone")
    assert not Path("/dev/null").is_file()


def test_a_full_disk_leaves_the_old_file_and_no_temporary_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "checkpoint"
    path.write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(FileError, match=r"checkpoint: cannot write: No space left on device"):
        write_atomic(path, b"new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["checkpoint"]


def test_an_interrupt_in_the_middle_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "checkpoint"
    path.write_text("old")

    def interrupted(descriptor: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomic(path, b"new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["checkpoint"]


def test_a_missing_folder_and_a_folder_in_the_way_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none/a: cannot write: No such file or directory"):
        write_atomic(tmp_path / "none" / "a", b"")
    with pytest.raises(FileError, match=r"cannot write: Is a directory"):
        write_atomic(tmp_path, b"")


def test_json_ends_with_a_newline_and_reads_back(tmp_path: Path) -> None:
    data = {"name": "größe", "values": [1, 2.5, None]}
    write_json(tmp_path / "a.json", data)
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert text.endswith("}\n")
    assert json.loads(text) == data
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", float("nan"))
    assert (tmp_path / "a.json").read_text(encoding="utf-8") == text


def test_json_has_an_escape_for_a_byte_of_a_path_that_is_no_utf_8(tmp_path: Path) -> None:
    path = os.fsdecode(b"e\xff\xc3\xa9")
    write_json(tmp_path / "a.json", {"run": path})
    assert (tmp_path / "a.json").read_bytes() == '{\n  "run": "e\\udcffé"\n}\n'.encode()
    assert json.loads((tmp_path / "a.json").read_text()) == {"run": path}


def test_a_read_stops_at_its_limit(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    assert read_capped(tmp_path / "a", 5) == b"12345"
    with pytest.raises(FileError, match=r"a: larger than 4 bytes"):
        read_capped(tmp_path / "a", 4)
    with pytest.raises(FileError, match=r"larger than 10 bytes"):
        read_capped("/dev/zero", 10)
    with pytest.raises(FileError, match=r"b: cannot read: No such file"):
        read_capped(tmp_path / "b", 4)


def test_a_folder_is_made_with_those_above_it_and_their_names_are_synced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[Path] = []
    monkeypatch.setattr(files, "sync_folder", synced.append)
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    assert synced == [tmp_path / "a", tmp_path]
    make_folder(tmp_path / "a" / "b")
    assert len(synced) == 2
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match=r"file/a: cannot be made: Not a directory"):
        make_folder(tmp_path / "file" / "a")


def test_temporary_files_of_the_dead_are_taken_away_and_no_others(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    kept = [f".a.json.{os.getpid()}.0123abcd.tmp", "a.tmp", ".a.tmp", ".a.7.0123abcg.tmp", "a.json"]
    for name in (*kept, f".a.json.{dead.pid}.0123abcd.tmp", f".a.{10**10 - 1}.0123abcd.tmp"):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path)
    assert sorted(os.listdir(tmp_path)) == sorted(kept)
    remove_leftovers(tmp_path / "missing")


def test_a_pipe_is_not_waited_for_where_a_file_should_be(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FileError, match=r"pipe: cannot read: not a regular file"):
        read_capped(tmp_path / "pipe", 5, regular=True)
    with pytest.raises(FileError, match=r"none: cannot read: No such file"):
        read_capped(tmp_path / "none", 5, regular=True)


def test_the_first_error_is_told_even_if_the_temporary_file_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(code: int) -> Callable[..., None]:
        def fail(*arguments: object, **options: object) -> None:
            raise OSError(code, os.strerror(code))

        return fail

    monkeypatch.setattr(os, "fsync", fails(errno.ENOSPC))
    monkeypatch.setattr(Path, "unlink", fails(errno.EIO))
    with pytest.raises(FileError, match="No space left on device"):
        write_atomic(tmp_path / "a", b"")


def test_links_in_a_folder_are_refused(tmp_path: Path) -> None:
    refuse_links(tmp_path)
    (tmp_path / "b").symlink_to("nowhere")
    with pytest.raises(FileError, match=r"/b: a link, which writing would follow"):
        refuse_links(tmp_path)


def test_a_folder_has_one_user_at_a_time(tmp_path: Path) -> None:
    leftover = tmp_path / f".x.{2**31 - 1}.0123abcd.tmp"
    leftover.touch()
    with sole_user(tmp_path):
        assert not leftover.exists()
        with pytest.raises(BitneatError, match="another process is at work there"), sole_user(tmp_path):
            pytest.fail("there are two")
    with sole_user(tmp_path):
        pass


def test_temporary_files_in_the_folders_that_a_user_names_go_too_but_not_through_links(tmp_path: Path) -> None:
    name = f".x.{2**31 - 1}.0123abcd.tmp"
    run, elsewhere = tmp_path / "run", tmp_path / "elsewhere"
    for folder in (run / "front", run / "notes", elsewhere):
        folder.mkdir(parents=True)
        (folder / name).touch()
    (run / "link").symlink_to(elsewhere)
    with sole_user(run, "front", "link", "missing"):
        assert not (run / "front" / name).exists()
        assert (run / "notes" / name).exists()
        assert (elsewhere / name).exists()


def test_a_user_that_is_killed_leaves_the_folder_to_the_next(tmp_path: Path) -> None:
    program = (
        "import sys, time, pathlib, subprocess\n"
        "from bitneat.files import sole_user\n"
        "with sole_user(pathlib.Path(sys.argv[1])):\n"
        "    child = subprocess.Popen(['sleep', '5'])\n"  # a worker of it may live on for a moment
        "    print('there', flush=True)\n"
        "    time.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"there\n"
    with pytest.raises(BitneatError, match="another process"), sole_user(tmp_path):
        pytest.fail("there are two")
    process.kill()
    process.wait()
    with sole_user(tmp_path):
        pass
    process.stdout.close()
