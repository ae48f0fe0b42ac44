"""The wheel, built from the source distribution, holds the five import packages and their data, installs, and runs."""

import os
import re
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    # built from a copy, so that no build folder is left in (or taken from) the source tree
    source = out / "source"
    files = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True)
    for name in files.stdout.splitlines():
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    build = [sys.executable, "-c", f"from setuptools import build_meta; build_meta.build_sdist({str(out)!r})"]
    subprocess.run(build, cwd=source, check=True, stdout=subprocess.DEVNULL)
    pip = [sys.executable, "-m", "pip", "-q", "--disable-pip-version-check"]
    sdist = str(next(out.glob("*.tar.gz")))
    subprocess.run([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(out), sdist], check=True)
    return next(out.glob("*.whl"))


def test_holds_exactly_the_five_packages_with_their_data(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == {"pps_vision", "rendering", "tracking", "learning", "control"}
    assert "pps_vision/robot/icub.urdf" in names
    assert {f"{top}/py.typed" for top in tops} <= set(names)


def test_installs_and_runs_in_a_clean_environment(wheel, tmp_path):
    venv.create(tmp_path / "env")
    python = tmp_path / "env" / "bin" / "python"
    environment = {**os.environ, "COLUMNS": "120", "PYTHONPATH": ""}
    run = {"check": True, "capture_output": True, "text": True, "cwd": tmp_path, "env": environment}
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps", "--no-index"]
    subprocess.run([*pip, wheel], **run)
    site = next((tmp_path / "env").glob("lib/python*/site-packages"))
    # the dependencies come from the environment that runs this test
    (site / "dependencies.pth").write_text(f"import site; site.addsitedir({sysconfig.get_paths()['purelib']!r})\n")
    where = subprocess.run([python, "-c", "import pps_vision.robot.icub as m; m.load_icub(); print(m.__file__)"], **run)
    assert str(site) in where.stdout
    script = tmp_path / "env" / "bin" / "pps-vision"
    help_text = subprocess.run([script, "--help"], **run).stdout
    for command in ("render", "track", "track2d", "learn", "show", "demo", "bench"):
        assert command in help_text


def test_the_declared_pythons_are_the_classified_ones(wheel):
    archive = zipfile.ZipFile(wheel)
    (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = archive.read(name).decode()
    after, first = map(int, re.findall(r"Requires-Python: <3\.(\d+),>=3\.(\d+)", metadata)[0])
    minors = [int(minor) for minor in re.findall(r"Python :: 3\.(\d+)", metadata)]
    assert minors == list(range(first, after))
    assert sys.version_info[:2] in [(3, minor) for minor in minors]
