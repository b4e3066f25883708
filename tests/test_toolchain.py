"""What a fresh machine meets first: the lock file, the set-up script and the search for LLVM."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from reference import doctor, toolchain
from scenes.contract import BadInput

ROOT = Path(__file__).resolve().parents[1]
BROKEN_LLVM = [p for p in toolchain.candidates() if 14 <= toolchain.llvm_version(p) <= 16]


@pytest.fixture
def libraries(tmp_path, monkeypatch):
    """A machine whose only folder of libraries is empty."""
    folder = tmp_path / "lib"
    folder.mkdir()
    monkeypatch.setattr(toolchain, "LIBRARY_FOLDERS", (str(folder),))
    monkeypatch.setattr(toolchain, "PACKAGED", str(tmp_path / "none"))
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setenv("LIGHTPROOF_CACHE", str(tmp_path / "cache"))
    return folder


def program(folder: Path, name: str, text: str) -> None:
    """A stand-in for a program of the system."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{text}\n")
    (folder / name).chmod(0o755)


@pytest.mark.parametrize(
    ("path", "version"),
    [
        ("/usr/lib/x86_64-linux-gnu/libLLVM-14.so.1", 14),
        ("/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1", 19),
        ("/usr/lib/llvm-18/lib/libLLVM.so", 18),
        ("/opt/homebrew/opt/llvm/lib/libLLVM.dylib", 0),
    ],
)
def test_version_is_read_from_the_library_s_name(path, version):
    assert toolchain.llvm_version(Path(path)) == version


def test_newest_library_comes_first_and_those_that_abort_come_last(libraries):
    for name in ("libLLVM-14.so.1", "libLLVM-17.so.1", "libLLVM.so.19.1", "libLLVM-15.so.1"):
        (libraries / name).touch()
    assert [toolchain.llvm_version(p) for p in toolchain.candidates()] == [19, 17, 15, 14]


def test_a_library_named_by_the_user_is_the_only_candidate(libraries, monkeypatch):
    (libraries / "libLLVM.so.19.1").touch()
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/named/libLLVM.so")
    assert toolchain.candidates() == [Path("/named/libLLVM.so")]


def test_without_llvm_the_one_command_is_named(libraries):
    assert toolchain.find_llvm() is None
    with pytest.raises(BadInput, match=r"found: none.*run .*llvm"):
        toolchain.use_device("cpu")
    check = doctor.llvm()
    assert not check.good and check.needed and check.mend == toolchain.install_llvm_command()


def test_a_file_that_is_no_library_is_tried_once_and_remembered(libraries, monkeypatch):
    (libraries / "libLLVM.so.19.1").write_text("not a library")
    assert toolchain.find_llvm() is None
    monkeypatch.setattr(toolchain.subprocess, "run", None)
    assert toolchain.find_llvm() is None
    (memory,) = json.loads((toolchain.cache_folder() / "llvm.json").read_text()).values()
    assert memory is False


@pytest.mark.parametrize(
    ("listed", "package"),
    [("14 15 17 18", "libllvm18"), ("17 19 20", "libllvm19"), ("14 15 16", "libllvm19"), ("", "libllvm19")],
)
def test_package_is_19_or_the_newest_from_17(listed, package, tmp_path, monkeypatch):
    lines = "\n".join(f"echo 'libllvm{v} - runtime library'" for v in listed.split())
    program(tmp_path / "bin", "apt-cache", lines)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert toolchain.newest_llvm_package() == package


@pytest.mark.skipif(not BROKEN_LLVM, reason="needs an LLVM of 14 to 16")
def test_an_llvm_that_aborts_costs_an_answer_and_not_the_process(tmp_path):
    if toolchain.works(BROKEN_LLVM[-1]):
        pytest.skip("this processor's code is within its reach")
    own = {"DRJIT_LIBLLVM_PATH": str(BROKEN_LLVM[-1]), "LIGHTPROOF_CACHE": str(tmp_path)}

    def run(*words):
        return subprocess.run(
            [sys.executable, "-m", "lightproof", *words],
            env={**os.environ, **own},
            cwd=ROOT,
            capture_output=True,
            text=True,
        )

    asked, version = run("doctor", "--json"), toolchain.llvm_version(BROKEN_LLVM[-1])
    llvm = next(row for row in json.loads(asked.stdout) if row["what"] == "LLVM")
    assert asked.returncode == 2 and asked.stderr == ""
    assert llvm["state"] == "missing" and llvm["mend"] == toolchain.install_llvm_command()
    assert re.fullmatch(rf"LLVM {version} \(.*\) aborts", llvm["found"])
    refused = run("list")
    assert refused.returncode == 2 and refused.stderr.count("\n") == 1
    assert toolchain.install_llvm_command() in refused.stderr


def test_doctor_looks_without_importing_what_may_abort():
    look = "import sys; from reference.doctor import examine; examine(); print('drjit' in sys.modules)"
    answer = subprocess.run([sys.executable, "-c", look], cwd=ROOT, capture_output=True, text=True)
    assert answer.stdout.strip() == "False"


def test_devices_are_named_in_full():
    with pytest.raises(BadInput, match="auto, cpu or gpu"):
        toolchain.use_device("tpu")


def locked() -> dict[str, list[str]]:
    """Package -> its lines in the lock, one per Python that differs."""
    text = (ROOT / "requirements.lock").read_text().replace("\\\n", " ")
    found = {}
    for line in text.splitlines():
        found.setdefault(line.split("==")[0], []).append(line)
    return found


def test_lock_pins_and_hashes_all_that_the_project_asks_for():
    text = (ROOT / "pyproject.toml").read_text()
    asked = re.findall(
        r'"([A-Za-z][\w-]*)', text[text.index("dependencies = [") : text.index("[project.scripts]")]
    )
    lock = locked()
    assert {"setuptools", *(name.lower() for name in asked)} <= set(lock)
    assert all("--hash=sha256:" in line for lines in lock.values() for line in lines)


def test_lock_names_no_server():
    assert not re.search(r"://|--index|--find-links", (ROOT / "requirements.lock").read_text())


@pytest.fixture
def checkout(tmp_path):
    """The set-up script beside the files that it reads, and a machine with few programs."""
    for name in ("tools/setup.sh", "requirements.lock", "pyproject.toml"):
        target = tmp_path / "checkout" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, target)
    for name in ("bash", "cat", "cmp", "dirname", "head", "rm", "touch"):
        (tmp_path / "bin").mkdir(exist_ok=True)
        (tmp_path / "bin" / name).symlink_to(shutil.which(name))
    program(tmp_path / "bin", "id", "echo 1000")
    return tmp_path


def set_up(place: Path, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [shutil.which("bash"), place / "checkout/tools/setup.sh", *words],
        env={"PATH": str(place / "bin"), "HOME": str(place)},
        capture_output=True,
        text=True,
    )


def test_setup_refuses_an_old_python_in_one_line(checkout):
    program(checkout / "bin", "python3", '[ "$1" = --version ] && echo Python 3.9.2 || exit 1')
    answer = set_up(checkout)
    assert answer.returncode == 2
    assert re.fullmatch(r"lightproof: needs Python 3\.10 or newer, found Python 3\.9\.2: .*\n", answer.stderr)


def test_setup_without_venv_names_the_package_where_it_may_not_install_it(checkout):
    program(
        checkout / "bin",
        "python3",
        'case "$2" in *ensurepip*) exit 1;; *format*) echo 3.11;; esac',
    )
    answer = set_up(checkout)
    assert answer.returncode == 2 and answer.stderr.count("\n") == 1
    assert "sudo apt-get update && sudo apt-get install -y python3.11-venv" in answer.stderr


def test_setup_says_nothing_and_does_nothing_when_nothing_is_missing(checkout):
    home = checkout / "checkout"
    (home / ".venv").mkdir()
    program(home / ".venv/bin", "python", f'echo "$@" >> {checkout}/calls')
    stamp = f"{home}\n" + "".join((home / n).read_text() for n in ("requirements.lock", "pyproject.toml"))
    (home / ".venv/installed").write_text(stamp)
    answer = set_up(checkout, "test")
    assert (answer.returncode, answer.stdout, answer.stderr) == (0, "", "")
    assert "pip" not in (checkout / "calls").read_text()
